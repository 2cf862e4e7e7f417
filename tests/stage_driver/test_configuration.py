"""The configurations made from parameters."""

import pytest

from stage_core.errors import StageError
from stage_driver.driver_parameters import PARAMETERS, axes_of, servo_config, zaber_config

from ..config_files import section

DEFAULTS = {parameter.name: parameter.default for parameter in PARAMETERS}


def test_servo_configuration():
    assert servo_config(DEFAULTS.__getitem__).axes == ('x', 'y')


def test_zaber_configuration():
    config = zaber_config(section('stage_driver_zaber')[1].__getitem__)
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
    values = {**section('stage_driver_zaber')[1], **changes}
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
