"""What a tracker shows of a machine with one axis."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from gap_diagnosis.diagnose import diagnose
from stage_core.session import Session

from .conftest import nominal

Maker = Callable[..., Session]


def test_an_offset_of_the_frame_is_all_that_one_axis_shows_of_it(planted: Maker) -> None:
    session = planted({'tracker_misalignment': {'angle': 0.0, 'offset_x': 20e-6}})
    found = diagnose([session], [], nominal())
    assert found.verdict == ['tracker_misalignment']
    assert found.parameters['tracker_misalignment']['offset_x'][0] == pytest.approx(2e-5, rel=0.01)


def test_an_offset_of_the_frame_alone_is_named(planted: Maker) -> None:
    offset = {'angle': 0.0, 'offset_x': 20e-6, 'offset_y': -8e-6}
    session = planted({'tracker_misalignment': offset}, axes=('x', 'y'))
    assert diagnose([session], [], nominal(('x', 'y'))).verdict == ['tracker_misalignment']


def test_a_curve_of_the_place_is_a_yaw_whose_arm_is_not_known(planted: Maker) -> None:
    yaw = {'linear': 0.0, 'quadratic': 1e-4, 'p3': 6e-5, 'arm': 0.1}
    place = {'centre': -0.0032, 'half_range': 0.0267}
    found = diagnose([planted({'angular_error.x': {**yaw, **place}})], [], nominal())
    assert found.verdict == ['angular_error.x']
    assert found.after < 1.1 * found.noise_floor
    stated = found.parameters['angular_error.x']
    assert stated['arm'][1] == stated['quadratic'][1] == 0.0
