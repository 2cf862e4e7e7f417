"""A wave that an encoder reads, told by the force where the axis never passes it fast."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from gap_diagnosis.diagnose import diagnose
from gap_diagnosis.input.data import load_record
from gap_diagnosis.input.driven_wave import driven_wave
from stage_core import topics
from stage_core.session import Session
from stage_core.twin_file import TwinFile
from tests.gap_diagnosis.conftest import nominal

Maker = Callable[..., Session]
READ = 'encoder_interpolation.x'
WAVE = {'amplitude': 8e-6, 'period': 2.9e-3, 'phase': 0.5}


def told(session: Session, twin: TwinFile) -> dict[str, tuple[float, float]]:
    record = load_record(session, twin)
    axis = twin.servo('x')
    return driven_wave(
        record.encoder[:, 0],
        record.force[:, 0] / axis.mass,
        record.period,
        record.whole(record.time),
        axis.encoder_resolution,
    )


@pytest.mark.parametrize(
    'hidden',
    [
        {},
        {'force_ripple.x': {'amplitude': 8.0, 'period': 2e-3}},
        {'coulomb_friction.x': {'coulomb': 12.0, 'presliding': 5e-6}},
        {'cyclic_pitch_error.x': {'amplitude': 8e-6, 'period': 2e-3}},
        {'inertia_mismatch.x': {'ratio': 1.2}},
    ],
)
def test_no_wave_is_read_where_none_is(
    planted: Maker, hidden: dict[str, dict[str, float]]
) -> None:
    assert told(planted(hidden), nominal()) == {}


def test_a_slow_wave_is_read(planted: Maker) -> None:
    found = told(planted({READ: WAVE}), nominal())
    for name, truth in WAVE.items():
        value, deviation = found[name]
        assert abs(value - truth) < 2.0 * deviation, name
    # It is told beside a friction, too.
    beside = planted({READ: WAVE, 'coulomb_friction.x': {'coulomb': 2.0, 'presliding': 5e-6}})
    assert told(beside, nominal())['period'][0] == pytest.approx(WAVE['period'], rel=0.01)


def test_without_a_tracker_the_loop_tells_such_a_wave(planted: Maker) -> None:
    session = planted({READ: WAVE})
    series = {k: v for k, v in session.series.items() if k != topics.TRACKER_POINT}
    found = diagnose([replace(session, series=series)], [], nominal())
    assert found.verdict == [READ]
    for name, truth in WAVE.items():
        value, deviation = found.parameters[READ][name]
        assert abs(value - truth) <= 3.0 * deviation, name
    assert found.after < 1.1 * found.noise_floor


def test_a_still_axis_has_no_wave() -> None:
    still, whole = np.zeros(3000), np.ones(3000, dtype=bool)
    assert driven_wave(still, still, 1e-3, whole, 1e-6) == {}
