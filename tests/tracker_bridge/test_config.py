"""The shipped parameter files name every parameter and hold its default."""

from pathlib import Path

import pytest
import yaml

CONFIG = Path(__file__).resolve().parents[2] / 'ros_ws' / 'config'


def flat(mapping, prefix=''):
    found = {}
    for name, value in mapping.items():
        if isinstance(value, dict):
            found |= flat(value, f'{prefix}{name}.')
        else:
            found[prefix + name] = value
    return found


@pytest.mark.parametrize('name', ['tracker_bridge', 'stage_twin'])
def test_config_is_complete(name):
    if name == 'tracker_bridge':
        from tracker_bridge.parameters import PARAMETERS
    else:
        from stage_twin.node import PARAMETERS

    text = (CONFIG / f'{name}.yaml').read_text()
    content = flat(yaml.safe_load(text)[name]['ros__parameters'])
    assert content == {parameter.name: parameter.default for parameter in PARAMETERS}
