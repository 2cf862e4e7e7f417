"""Input that cannot be diagnosed: one line, exit status 2, no report."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from gap_diagnosis.__main__ import main
from gap_diagnosis.input.checks import check_duration, check_units
from session_bags.writer import write_session
from stage_core import topics
from stage_core.errors import StageError
from stage_core.session import Series, Session
from stage_core.twin_file import TwinFile

Maker = Callable[..., Session]


def without(session: Session, topic: str) -> Session:
    return replace(session, series={k: s for k, s in session.series.items() if k != topic})


def changed(session: Session, topic: str, **columns: np.ndarray) -> Session:
    old = session.series[topic]
    values = {**old.values, **{k.replace('_', '.'): v for k, v in columns.items()}}
    return replace(session, series={**session.series, topic: Series(topic, old.stamps, values)})


def shifted(session: Session, topic: str, seconds: float) -> Session:
    old = session.series[topic]
    late = Series(topic, old.stamps + np.int64(seconds * 1e9), old.values)
    return replace(session, series={**session.series, topic: late})


def nan_encoder(session: Session) -> Session:
    position = session.series[topics.JOINT_STATES].values['position.x'].copy()
    position[1000] = np.nan
    return changed(session, topics.JOINT_STATES, position_x=position)


def wrong_once(session: Session, topic: str, column: str, value: float) -> Session:
    values = session.series[topic].values[column].copy()
    values[len(values) // 2] = value
    return changed(session, topic, **{column.replace('.', '_'): values})


def still(session: Session) -> Session:
    zero = np.zeros(len(session.series[topics.REFERENCE]))
    for topic in (topics.REFERENCE, topics.JOINT_STATES):
        session = changed(session, topic, position_x=zero)
    return session


def cut(session: Session, seconds: float) -> Session:
    start = session.start_ns
    stop = start + int(seconds * 1e9)
    return replace(session, series={k: s.between(start, stop) for k, s in session.series.items()})


CASES: list[tuple[str, Callable[[Session], Session], str]] = [
    ('no reference', lambda s: without(s, topics.REFERENCE), topics.REFERENCE),
    ('no encoder', lambda s: without(s, topics.JOINT_STATES), topics.JOINT_STATES),
    ('NaN', nan_encoder, 'NaN|not.*number'),
    (
        'one wrong reading of the encoder',
        lambda s: wrong_once(s, topics.JOINT_STATES, 'position.x', 1e3),
        'encoder of axis x has single values far from all others',
    ),
    (
        'one wrong point of the tracker',
        lambda s: wrong_once(s, topics.TRACKER_POINT, 'x', 1e3),
        'has single values far from all others',
    ),
    (
        'one wrong effort',
        lambda s: wrong_once(s, topics.COMMAND, 'effort.x', 1e12),
        'effort of axis x is 1e.12 N at .* far beyond the force_limit',
    ),
    ('no motion', still, 'motion is missing'),
    ('too short', lambda s: cut(s, 3.0), 'too short'),
    ('tracker at another time', lambda s: shifted(s, topics.TRACKER_POINT, 900.0), 'overlap'),
    ('command at another time', lambda s: shifted(s, topics.COMMAND, 900.0), 'overlap'),
]


@pytest.mark.parametrize(('name', 'spoil', 'words'), CASES, ids=[c[0] for c in CASES])
def test_a_spoilt_session_is_refused(
    planted: Maker,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    name: str,
    spoil: Callable[[Session], Session],
    words: str,
) -> None:
    import re

    bag = write_session(tmp_path / 'bag', spoil(planted({}, duration=10.0)))
    TwinFile.nominal_servo().save(tmp_path / 'twin.yaml')
    status = main(
        ['diagnose', '--bag', str(bag), '--twin', str(tmp_path / 'twin.yaml')]
        + ['--out', str(tmp_path / 'out'), '--quiet']
    )
    error = capsys.readouterr().err.strip()
    assert status == 2
    assert len(error.splitlines()) == 1
    assert re.search(words, error), error
    assert not (tmp_path / 'out' / 'report.json').exists()


def test_an_axis_or_a_kind_that_the_twin_lacks(
    planted: Maker, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = write_session(tmp_path / 'bag', planted({}, duration=10.0))
    twin = TwinFile.nominal_servo()
    replace(twin, axes={'y': twin.axes['y']}).save(tmp_path / 'y.yaml')
    (tmp_path / 'stepper.yaml').write_text('kind: stepper\naxes: {x: {}}\n')
    for name, word in (('y', 'axis x'), ('stepper', 'stepper'), ('absent', 'absent.yaml')):
        arguments = ['--bag', str(bag), '--twin', str(tmp_path / f'{name}.yaml'), '--quiet']
        assert main([*arguments, '--out', str(tmp_path / 'out')]) == 2
        assert word in capsys.readouterr().err
    arguments = ['--bag', str(tmp_path / 'nowhere'), '--twin', str(tmp_path / 'y.yaml')]
    assert main([*arguments, '--out', str(tmp_path / 'out'), '--quiet']) == 2
    assert 'nowhere' in capsys.readouterr().err


def test_short_records_count_together() -> None:
    def lasting(*seconds: float) -> list[Any]:
        return [SimpleNamespace(name=f'{s:g} s', duration=s) for s in seconds]

    check_duration(lasting(3.0, 3.0, 2.0))
    with pytest.raises(StageError, match='6.0 s.*at least 8 s'):
        check_duration(lasting(3.0, 3.0))
    with pytest.raises(StageError, match='0.5 s is too short.*leave it out'):
        check_duration(lasting(10.0, 0.5))


@pytest.mark.parametrize(('wrong', 'refused'), [([1e9], True), ([1.0] * 2000, False), ([], False)])
def test_a_wrong_reading_of_an_axis_at_rest_is_told_from_a_push(
    wrong: list[float], refused: bool
) -> None:
    encoder = 1e-6 * np.random.default_rng(0).standard_normal((10_000, 1))
    encoder[100 : 100 + len(wrong), 0] = wrong
    record: Any = SimpleNamespace(
        name='bag', axes=('y',), encoder=encoder, reference=np.zeros_like(encoder)
    )
    if not refused:
        check_units(record)
        return
    with pytest.raises(StageError, match='the encoder of axis y has single values far from all'):
        check_units(record)
