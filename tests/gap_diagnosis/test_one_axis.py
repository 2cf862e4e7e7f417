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
