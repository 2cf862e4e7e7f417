"""The console script, and the page that the library prints."""

import re
from pathlib import Path

import numpy as np
import pytest

from stage_core.twin_file import TwinFile
from stage_twin.effects import EFFECTS
from stage_twin.effects.__main__ import table
from stage_twin.packing import pack
from stage_twin.simulate_command import circle, main

ROOT = Path(__file__).resolve().parents[2]
CONFIG = ROOT / 'ros_ws' / 'config'


def numbers(line):
    return [float(word) for word in re.findall(r'-?\d+\.\d+', line)]


def test_reality_differs_from_nominal_where_it_is_told_to(capsys):
    rows = {}
    for name in ('nominal', 'reality'):
        assert main(['--twin', str(CONFIG / f'twin_{name}.yaml'), '--seconds', '4']) == 0
        printed = capsys.readouterr().out.splitlines()
        assert printed[0].endswith('effects: none') == (name == 'nominal')
        rows[name] = {line[0]: numbers(line) for line in printed if line[:2] in ('x ', 'y ')}
    # Columns: following rms, max; table rms, max; force rms, max.
    assert rows['nominal']['x'][3] < 1.0
    assert rows['reality']['x'][3] > 4.0
    assert rows['reality']['x'][4] > rows['nominal']['x'][4] + 2.0
    assert rows['reality']['y'][4] == rows['nominal']['y'][4]


@pytest.mark.parametrize(
    ('arguments', 'words'),
    [
        (['--twin', 'absent.yaml'], 'cannot read twin file absent.yaml'),
        (['--twin', str(CONFIG / 'twin_stepper_nominal.yaml')], 'this one is stepper'),
        (['--twin', str(CONFIG / 'twin_nominal.yaml'), '--seconds', '0'], '--seconds'),
    ],
)
def test_wrong_arguments_print_one_line(arguments, words, capsys):
    assert main(arguments) == 2
    error = capsys.readouterr().err
    assert words in error
    assert error.count('\n') == 1


def test_circle_s_velocity_is_the_derivative_of_its_position():
    twin = TwinFile.nominal_servo()
    position, velocity = circle(twin, 2.0, 0.03, 0.05)
    derivative = np.gradient(position, twin.control_period, axis=0)
    np.testing.assert_allclose(velocity[1:-1], derivative[1:-1], atol=1e-6)
    radii = np.hypot(position[:, 0] - 0.03, position[:, 1])
    np.testing.assert_allclose(radii, 0.03, rtol=1e-12)


@pytest.mark.parametrize('name', ['nominal', 'reality', 'stepper_nominal', 'stepper_reality'])
def test_twin_files_of_the_workspace_are_good(name):
    twin = TwinFile.load(CONFIG / f'twin_{name}.yaml')
    pack(twin)
    assert bool(twin.effects) == name.endswith('reality')


def test_the_page_holds_the_printed_library():
    printed = table()
    assert printed in (ROOT / 'docs' / 'concepts' / 'twin.md').read_text(encoding='utf-8')
    for effect in EFFECTS.values():
        for parameter in effect.parameters:
            # The members of a numbered array share a row.
            assert f'`{parameter.name.rstrip("0123456789")}' in printed
