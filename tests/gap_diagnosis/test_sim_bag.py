"""A simulator's run of the same command in place of the twin's prediction."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.without_forces import mute
from gap_diagnosis.__main__ import main
from gap_diagnosis.closed_loop.replay import replay
from gap_diagnosis.closed_loop.simulated import beside, of_simulator
from gap_diagnosis.diagnose import diagnose
from gap_diagnosis.input.data import load_record
from session_bags.writer import write_session
from stage_core import topics
from stage_core.errors import StageError
from stage_core.session import Series, Session

from .conftest import nominal

Maker = Callable[..., Session]

#: What machine and simulator both have, and the rig's file has not.
SHARED = {
    'coulomb_friction.x': {'coulomb': 5.0, 'presliding': 1e-6},
    'scale_error.x': {'error': 2e-4},
}
LACKS = {'backlash.x': {'width': 8e-6}, 'viscous_friction.x': {'viscous': 60.0}}


def test_only_what_the_simulator_lacks_is_named(planted: Maker, tmp_path: Path) -> None:
    bags = {'real': SHARED | LACKS, 'sim': SHARED}
    for name, effects in bags.items():
        write_session(tmp_path / name, planted(effects, seed=len(name)))
    nominal().save(tmp_path / 'rig.yaml')
    words = ['--bag', str(tmp_path / 'real'), '--sim-bag', str(tmp_path / 'sim')]
    words += ['--twin', str(tmp_path / 'rig.yaml'), '--out', str(tmp_path / 'out'), '--quiet']
    assert main(['diagnose', *words]) == 0
    report = json.loads((tmp_path / 'out' / 'report.json').read_text())
    assert set(report['verdict']) == set(LACKS)
    assert report['simulated'] == str(tmp_path / 'sim')
    found = {c['effect']: c['parameters'] for c in report['causes']}
    assert found['backlash.x']['width']['value'] == pytest.approx(8e-6, rel=0.1)
    assert found['viscous_friction.x']['viscous']['value'] == pytest.approx(60.0, rel=0.1)
    gap = report['gap']
    assert gap['after'] < 1.3 * gap['noise_floor'] < 0.5 * gap['before']
    page = (tmp_path / 'out' / 'report.html').read_text()
    assert 'The simulator lacks' in page


def test_after_is_real_less_simulated_less_what_the_effects_add(planted: Maker) -> None:
    real, run = planted(SHARED | LACKS), planted(SHARED)
    twin = of_simulator(nominal(), [run])
    record = load_record(real, twin)
    both = beside(record, load_record(run, twin), twin)
    gap = replay(both, twin, {})['encoder.x']
    ours, theirs = (s.series[topics.JOINT_STATES].values['position.x'] for s in (real, run))
    assert gap == pytest.approx(ours - theirs, abs=1e-12)
    after = replay(both, twin, LACKS)['encoder.x']
    # The record alone gives real - twin: the twins' difference is what the effects add.
    plain, richer = (replay(record, twin, e)['encoder.x'] for e in ({}, LACKS))
    assert gap - after == pytest.approx(plain - richer, abs=1e-12)


def test_a_simulator_that_is_right_has_no_gap_whatever_the_rig_says(planted: Maker) -> None:
    heavy = {'inertia_mismatch.x': {'ratio': 0.3}, **SHARED}
    found = diagnose([planted(heavy)], [], nominal(), simulated=[planted(heavy, seed=5)])
    assert found.verdict == []
    assert found.before < 1.3 * found.noise_floor


def test_a_simulator_with_other_gains_than_the_machine(planted: Maker) -> None:
    wrong = {'controller_mismatch.x': {'velocity_gain_error': -0.3}}
    found = diagnose([planted({})], [], nominal(), simulated=[planted(wrong)])
    assert found.verdict == ['controller_mismatch.x']
    error = found.parameters['controller_mismatch.x']['velocity_gain_error'][0]
    assert error == pytest.approx(1.0 / 0.7 - 1.0, rel=0.05)
    assert found.after < 0.3 * found.before


def test_a_machine_without_effort_beside_a_simulator_with_it(planted: Maker) -> None:
    """Names and figures of what the simulator lacks; of the mass that gains and mass differ."""
    lacks = {'backlash.x': {'width': 8e-6}, 'coulomb_friction.x': {'coulomb': 5.0}}
    run = planted({'scale_error.x': {'error': 2e-4}}, seed=3)
    real = mute(planted({**lacks, 'scale_error.x': {'error': 2e-4}}, seed=4))
    found = diagnose([real], [], nominal(), simulated=[run])
    assert set(found.verdict) == set(lacks)
    coulomb = found.parameters['coulomb_friction.x']['coulomb'][0]
    assert coulomb == pytest.approx(5.0, rel=0.03)
    assert found.after < 1.3 * found.noise_floor
    friction = {'coulomb_friction.x': {'coulomb': 5.0}}
    heavy = mute(planted({**friction, 'inertia_mismatch.x': {'ratio': 0.3}}))
    other = diagnose([heavy], [], nominal(), simulated=[planted(friction)])
    assert other.verdict == ['unknown']
    assert any('velocity gain over mass is 0.7' in text for text in other.warnings)
    with pytest.raises(StageError, match='simulator knows its forces'):
        diagnose([real], [], nominal(), simulated=[mute(run)])


def shifted(session: Session, ticks: int, epoch: int) -> Session:
    """The session begun some ticks later, at another epoch."""

    def cut(series: Series) -> Series:
        return replace(
            series,
            stamps=series.stamps[ticks:] + epoch,
            values={k: v[ticks:] for k, v in series.values.items()},
        )  # fmt: skip

    stage = (topics.REFERENCE, topics.COMMAND, topics.JOINT_STATES)
    series = {k: cut(s) if k in stage else replace(s, stamps=s.stamps + epoch)
              for k, s in session.series.items()}  # fmt: skip
    return replace(session, series=series)


def test_a_run_may_begin_elsewhere_and_at_another_time(planted: Maker) -> None:
    axes = ('x', 'y')
    real, run = planted(LACKS, axes=axes), planted({}, axes=axes)
    twin = nominal(axes)
    record = load_record(real, twin)
    late = load_record(shifted(run, 250, 10**15), twin)
    both = beside(record, late, twin)
    assert both.simulated is not None
    there = both.whole(both.time)
    assert there[600:].all()
    assert not there[:240].any()
    plain = beside(record, load_record(run, twin), twin)
    assert plain.simulated is not None
    assert both.simulated.encoder[there] == pytest.approx(plain.simulated.encoder[there])
    assert both.tracker is not None
    assert np.abs(both.tracker - plain.tracker)[50:].max() < 5e-6  # their noises differ


def test_another_command_is_refused(planted: Maker) -> None:
    twin = nominal()
    other = planted({})
    moved = other.series[topics.REFERENCE]
    wrong = replace(moved, values={k: 1.01 * v for k, v in moved.values.items()})
    run = replace(other, series={**other.series, topics.REFERENCE: wrong})
    with pytest.raises(StageError, match='did not run the command'):
        beside(load_record(planted({}), twin), load_record(run, twin), twin)


def test_a_run_for_each_bag(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    nominal().save(tmp_path / 'rig.yaml')
    words = ['diagnose', '--bag', 'a', '--bag', 'b', '--sim-bag', 'c', '--out', str(tmp_path)]
    assert main([*words, '--twin', str(tmp_path / 'rig.yaml')]) == 2
    assert 'one --sim-bag for each' in capsys.readouterr().err
