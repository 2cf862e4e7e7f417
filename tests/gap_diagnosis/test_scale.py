"""The verdict knows no unit of length: a machine ten times as large is diagnosed alike."""

from __future__ import annotations

from dataclasses import replace

import pytest

from gap_diagnosis.diagnose import diagnose
from gap_diagnosis.result import Diagnosis
from stage_core.session import Series, Session
from stage_core.twin_file import TrackerSpec, TwinFile

from .conftest import make_session, nominal

TIMES = 10.0
#: Masses stay, so that forces grow as lengths do.
GROWING = ('position', 'velocity', 'effort', 'x', 'y', 'z')
PLANTED = {
    'coulomb_friction.x': {'coulomb': 12.0, 'presliding': 5e-6},
    'cyclic_pitch_error.x': {'amplitude': 4e-6, 'period': 0.01, 'phase': 0.7},
}


def _larger(session: Session) -> Session:
    def grown(series: Series) -> Series:
        values = series.values.items()
        factors = {name: TIMES if name.split('.')[0] in GROWING else 1.0 for name, _ in values}
        return replace(series, values={n: factors[n] * column for n, column in values})

    return replace(session, series={n: grown(s) for n, s in session.series.items()})


def _larger_twin(twin: TwinFile) -> TwinFile:
    axis = twin.servo('x')
    own = replace(
        axis,
        encoder_resolution=TIMES * axis.encoder_resolution,
        lead=TIMES * axis.lead,
        force_limit=TIMES * axis.force_limit,
    )
    assert twin.tracker is not None
    tracker = TrackerSpec(twin.tracker.rate, TIMES * twin.tracker.noise)
    return replace(twin, axes={'x': own}, tracker=tracker)


def _value(found: Diagnosis, effect: str, parameter: str) -> float:
    return found.parameters[effect][parameter][0]


def test_the_verdict_does_not_change_with_the_length_of_a_metre() -> None:
    session, twin = make_session(PLANTED, duration=12.0), nominal(('x',))
    small = diagnose([session], [], twin)
    large = diagnose([_larger(session)], [], _larger_twin(twin))
    assert large.verdict == small.verdict == list(PLANTED)
    assert large.before == pytest.approx(TIMES * small.before, rel=1e-3)
    assert large.after == pytest.approx(TIMES * small.after, rel=0.1)
    for effect, parameter in (
        ('coulomb_friction.x', 'coulomb'),
        ('cyclic_pitch_error.x', 'amplitude'),
        ('cyclic_pitch_error.x', 'period'),
    ):
        grown = TIMES * _value(small, effect, parameter)
        assert _value(large, effect, parameter) == pytest.approx(grown, rel=0.02)
