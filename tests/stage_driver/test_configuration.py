"""The shipped parameter files, and the configurations made from parameters."""

from pathlib import Path

import pytest
import yaml

from stage_core.errors import StageError
from stage_core.parameters import check
from stage_driver.driver_parameters import PARAMETERS, axes_of, servo_config, zaber_config

CONFIG = Path(__file__).resolve().parents[2] / 'ros_ws' / 'config'
DEFAULTS = {parameter.name: parameter.default for parameter in PARAMETERS}


def flat(content, prefix=''):
    for name, value in content.items():
        if isinstance(value, dict):
            yield from flat(value, f'{prefix}{name}.')
        else:
            yield prefix + name, value


def read(name):
    content = yaml.safe_load((CONFIG / name).read_text(encoding='utf-8'))
    return dict(flat(content['stage_driver']['ros__parameters']))


@pytest.mark.parametrize('name', ['stage_driver_servo.yaml', 'stage_driver_zaber.yaml'])
def test_shipped_files_hold_every_parameter_with_a_good_value(name):
    values = read(name)
    assert set(values) == set(DEFAULTS)
    for parameter in PARAMETERS:
        assert check(parameter, values[parameter.name]) is None
        assert parameter.description


def test_servo_file_holds_the_defaults():
    assert read('stage_driver_servo.yaml') == DEFAULTS
    assert servo_config(DEFAULTS.__getitem__).axes == ('x', 'y')


def test_zaber_configuration():
    config = zaber_config(read('stage_driver_zaber.yaml').__getitem__)
    assert config.devices == (1, 2) and config.microsteps == (4.7625e-8, 4.7625e-8)


@pytest.mark.parametrize(
    ('changes', 'words'),
    [
        ({'port': ''}, 'needs parameter port'),
        ({'y.device': 1}, 'same device'),
        ({'axes': []}, 'axes'),
    ],
)
def test_impossible_zaber_configurations_are_refused(changes, words):
    values = {**read('stage_driver_zaber.yaml'), **changes}
    with pytest.raises(StageError, match=words):
        zaber_config(values.__getitem__)


def test_one_axis_is_enough_and_unknown_ones_are_not():
    assert axes_of({'axes': ['y']}.__getitem__) == ('y',)
    with pytest.raises(StageError, match='axes must be taken from x, y'):
        axes_of({'axes': ['x', 'z']}.__getitem__)


def test_friction_rows_reach_the_loop():
    values = {**DEFAULTS, 'friction_compensation': 'lugre', 'x.coulomb_force': 20.0}
    friction = servo_config(values.__getitem__).friction
    assert friction is not None and friction[0].tolist() == [20.0, 20.0, 0.001, 2e-6]


def test_missing_twin_file_is_named():
    values = {**DEFAULTS, 'twin': '/no/such/twin.yaml'}
    with pytest.raises(StageError, match='/no/such/twin.yaml'):
        servo_config(values.__getitem__)
