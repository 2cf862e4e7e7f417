"""A friction that the twin states is told where the axis slides, as no two models rest alike."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from gap_diagnosis.closed_loop.axis_loop import AxisLoop
from gap_diagnosis.closed_loop.channels import Channel
from gap_diagnosis.closed_loop.creep import with_presliding
from gap_diagnosis.closed_loop.replay import fitted_gap
from gap_diagnosis.closed_loop.slides import LEFT_BEHIND, SETTLED, settling_time, sliding
from gap_diagnosis.closed_loop.unexplained import Sliding, far, grown_notes
from gap_diagnosis.diagnose import diagnose
from gap_diagnosis.evidence.judgement import channel_floor
from gap_diagnosis.input.data import load_record
from gap_diagnosis.passes import prepare
from gap_diagnosis.selection.servo_part import _worse
from stage_core.session import Session

from .conftest import nominal

Maker = Callable[..., Session]

NAME = 'coulomb_friction.x'
STATED = {NAME: {'coulomb': 12.0, 'presliding': 1e-6}}
SOFTER = {NAME: {'coulomb': 12.0, 'presliding': 8e-6}}


@pytest.mark.parametrize(
    ('hidden', 'is_far'), [({}, False), ({'viscous_friction.x': {'viscous': 100.0}}, True)]
)
def test_another_presliding_is_no_gap_and_a_viscous_friction_is(
    planted: Maker, hidden: dict[str, dict[str, float]], is_far: bool
) -> None:
    prepared = prepare([planted({**SOFTER, **hidden})], [], nominal().with_effects(STATED), [])
    floor = channel_floor(prepared.seen, 'encoder.x')
    assert fitted_gap(prepared.records, prepared.twin, {}, 'x') > 4.0 * floor
    channels = {'encoder.x': Channel('encoder.x', 'm', [], [], [])}
    assert far(prepared.records, prepared, [], channels, {}, {}, {}) is is_far


def test_what_another_presliding_does_contradicts_no_effect(planted: Maker) -> None:
    """With the right delay the loop is twice as far from the record at its rests."""
    name, hidden = 'actuation_delay.x', {'delay': 2e-3}
    twin = nominal().with_effects(STATED)
    session = planted({**SOFTER, name: hidden})
    records = prepare([session], [], twin, []).records
    loop = AxisLoop(records, twin, 'x')
    found = {name: {k: (v, 1e-6) for k, v in hidden.items()}}
    assert _worse([name], found, loop) == [name]
    assert _worse([name], found, replace(loop, sliding=True)) == []
    told = diagnose([session], [], twin)
    assert told.verdict == [name] and not told.rests_as_stated
    assert any('The twin with presliding' in warning for warning in told.warnings)


def test_a_presliding_with_which_the_loop_comes_no_closer_is_not_taken(planted: Maker) -> None:
    twin = nominal().with_effects(STATED)
    for hidden, taken in ((SOFTER, True), (STATED, False)):
        records = prepare([planted(hidden)], [], twin, []).records
        run = with_presliding(records, twin, {}, {NAME: 8e-6})
        assert (run.effects[NAME]['presliding'] == 8e-6) is taken


def test_an_axis_slides_a_while_after_it_has_left_where_it_turned(planted: Maker) -> None:
    record = load_record(planted({}), nominal())
    velocity = np.zeros_like(record.reference_velocity)
    way = {(0.5, 2.0): 0.01, (2.0, 3.5): -0.01, (3.5, 5.0): -1e-5}
    for (start, stop), speed in way.items():
        velocity[(record.time >= start) & (record.time < stop)] = speed
    twin = nominal().with_effects(SOFTER)
    held = 0.2  # s for which the axis stays where it turned
    moves = (np.mod(record.time - 0.5, 1.5) > held)[:, None]
    place = np.cumsum(np.where(moves, velocity, 0.0), axis=0) * record.period
    found = sliding(replace(record, reference_velocity=velocity, encoder=place), twin, 'x')
    settled = held + LEFT_BEHIND * 8e-6 / 0.01 + SETTLED * settling_time(twin.servo('x'))
    runs = [record.time[found & (record.time < 2.0)], record.time[found & (record.time >= 2.0)]]
    for times, start, stop in zip(runs, (0.5, 2.0), (2.0, 3.5), strict=True):
        assert times.min() == pytest.approx(start + settled, abs=0.01)
        assert times.max() == pytest.approx(stop, abs=0.01)


def test_a_loop_settles_with_its_slowest_pole() -> None:
    axis = replace(nominal().servo('x'), mass=2.0, viscous=0.0)
    _, second, first, last = np.poly([-10.0, -50.0, -100.0])
    place = np.roots([second, -first, last]).real.min()
    gains = {'velocity_gain': 2.0 * second, 'position_gain': place}
    full = replace(axis, **gains, integral_gain=2.0 * last / place)
    assert settling_time(full) == pytest.approx(0.1)
    # Without an integral gain two poles are left, whose product is 160 place.
    slowest = -np.roots([1.0, second, second * place]).real.max()
    assert settling_time(replace(axis, **gains, integral_gain=0.0)) == pytest.approx(1.0 / slowest)


def test_rows_that_slide_are_those_that_count() -> None:
    rest, moving = np.full(100, 5e-6), np.full(50, 1e-6)
    gap = np.concatenate([rest, moving])
    channel = Channel('encoder.x', 'm', [np.arange(150.0)], [2.0 * gap], [gap])
    rows = [gap < 2e-6]
    sides = channel.sides(1e-7, [9.0 * gap**2], rows)
    assert sides.without == pytest.approx(9.0 * moving**2)
    assert sides.with_it == pytest.approx(moving**2)
    assert sides.nominal == pytest.approx(4e-12)
    assert Sliding(rows, 0.6e-6).is_noise(sides)
    assert not Sliding(rows, 0.4e-6).is_noise(sides)


def test_a_gap_that_grows_only_where_the_axis_rests_is_said() -> None:
    rests, moves = np.full(50, 1e-6), np.full(50, 2e-6)
    before, after = np.append(rests, moves), np.append(6.0 * rests, 0.1 * moves)
    slides = np.append(np.zeros(50, bool), np.ones(50, bool))
    grown = Channel('encoder.x', 'm', [np.arange(100.0)], [before], [after])
    sliding = {'encoder.x': Sliding([slides], 1e-8)}
    (note,) = grown_notes({'encoder.x': grown}, sliding)
    assert 'from 1.58 to 4.24 µm' in note and 'from 2 to 0.2 µm' in note
    shrunk = Channel('encoder.x', 'm', grown.time, [after], [before])
    assert grown_notes({'encoder.x': shrunk}, sliding) == []
