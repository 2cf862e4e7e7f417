"""A stepper stage is diagnosed from its rests: kinematics and sensor, no servo link."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gap_diagnosis.__main__ import main
from gap_diagnosis.diagnose import diagnose
from gap_diagnosis.input.stepper import _repeats, _Rests, sides
from session_bags.writer import write_session
from stage_core import topics
from stage_core.errors import StageError
from stage_core.session import Series, Session
from stage_core.twin_file import StepperAxis, TrackerSpec, TwinFile
from stage_twin.kinematics import carry
from stage_twin.packing import pack
from stage_twin.tracker import measure

START = 1_750_000_000_000_000_000
SCATTER = 0.75e-6  # m, a quarter of a repeatability of 3 µm
EFFECTS = {
    'scale_error.x': {'error': 150e-6},
    'backlash.y': {'width': 8e-6},
    'cyclic_pitch_error.y': {'amplitude': 4e-6, 'phase': 0.7},
}


def nominal() -> TwinFile:
    axes = {axis: StepperAxis() for axis in ('x', 'y')}
    return TwinFile('stepper', axes, 0.01, tracker=TrackerSpec(100.0, 1e-6))


def stepper_session(
    effects: dict[str, dict[str, float]],
    moves: int = 40,
    noise: float = 1e-6,
    places: np.ndarray | None = None,
) -> Session:
    """Moves of 0.4 s with rests of 0.6 s in between, counted 50 times a second.

    The stops are anywhere, or go through some places (k, 2) [m] in turn.
    """
    generator = np.random.default_rng(5)
    twin = nominal()
    stops = generator.uniform(-0.04, 0.04, (moves, 2))
    stops = stops if places is None else places[np.arange(moves) % len(places)]
    stops = np.rint(stops / 0.047625e-6) * 0.047625e-6
    s = np.clip(np.arange(100) / 40.0, 0.0, 1.0)[:, None]
    s = s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
    starts = np.vstack([np.zeros((1, 2)), stops[:-1]])
    motor = np.concatenate([a + (b - a) * s for a, b in zip(starts, stops, strict=True)])
    real = replace(twin.with_effects(effects), tracker=TrackerSpec(100.0, noise))
    seen_at, seen = measure(real, pack(real), carry(real, motor), None, 1, True)
    # Where a move ends scatters; each stop has a deviation of its own.
    scatter = np.repeat(SCATTER * generator.standard_normal((moves, 2)), 100, axis=0)
    points = seen[:, :2] + scatter[: len(seen)]
    stamps = START + np.arange(len(motor)) * 10_000_000
    counted = np.rint(motor[::2] / 0.047625e-6)
    still = np.zeros(len(counted))

    def joints(topic: str, values: dict[str, np.ndarray]) -> Series:
        return Series(topic, stamps[::2], values)

    series = {
        topics.REFERENCE: joints(
            topics.REFERENCE, {f'position.{a}': motor[::2, i] for i, a in enumerate('xy')}
        ),
        topics.COMMAND: joints(topics.COMMAND, {f'velocity.{a}': still for a in 'xy'}),
        topics.JOINT_STATES: joints(
            topics.JOINT_STATES, {f'position.{a}': counted[:, i] for i, a in enumerate('xy')}
        ),
        topics.TRACKER_POINT: Series(
            topics.TRACKER_POINT,
            START + np.rint(seen_at * 1e9).astype(np.int64),
            {'x': points[:, 0], 'y': points[:, 1], 'z': np.zeros(len(points))},
        ),
    }
    return Session('stepper', series, twin.to_dict(), None)


def test_planted_effects_are_named_from_counted_steps(tmp_path: Path) -> None:
    session = stepper_session(EFFECTS)
    found = diagnose([session], [], nominal())
    assert set(found.verdict) == set(EFFECTS)
    assert found.link == 'kinematic'
    assert set(found.channels) == {'tracker.x', 'tracker.y'}
    for name, values in EFFECTS.items():
        for key, value in values.items():
            assert found.parameters[name][key][0] == pytest.approx(value, rel=0.15)
    # What remains is where the moves end.
    assert found.after < 1.4 * SCATTER < 0.5 * found.before
    bag = write_session(tmp_path / 'bag', session, nominal())
    nominal().save(tmp_path / 'twin.yaml')
    words = ['diagnose', '--bag', str(bag), '--twin', str(tmp_path / 'twin.yaml'), '--quiet']
    assert main([*words, '--out', str(tmp_path / 'out')]) == 0
    assert TwinFile.load(tmp_path / 'out' / 'corrected_twin.yaml').kind == 'stepper'
    assert (tmp_path / 'out' / 'report.html').exists()


@pytest.mark.parametrize(
    ('count', 'told'), [(2, set()), (3, {'scale_error.x'}), (12, {'scale_error.x'})]
)
def test_few_places_tell_no_effect_of_the_place(count: int, told: set[str]) -> None:
    """A curve of two parameters meets two places, and an effect of one with an offset too."""
    x, y = np.linspace(-0.03, 0.031, count), 1e-3 * np.array([7.0, -9.0, 2.0])
    places = np.column_stack([x, np.resize(y, count)])
    session = stepper_session({'scale_error.x': {'error': 150e-6}}, places=places)
    found = diagnose([session], [], nominal())
    assert set(found.verdict) - {'tracker_misalignment', 'unknown'} == told
    assert ('unknown' in found.verdict) == (not told)
    assert any(f'axis x rested at {count} places' in w for w in found.warnings) == (count < 6)


def test_a_tracker_noisier_than_its_twin_says_is_measured() -> None:
    play = {'backlash.y': EFFECTS['backlash.y']}
    found = diagnose([stepper_session(play, noise=9e-6)], [], nominal())
    assert found.verdict == ['backlash.y']
    # The means of 24 to 60 points, and the table scatters beside.
    assert 9e-6 / 60**0.5 < found.noise_floor < np.hypot(9e-6 / 24**0.5, SCATTER)
    assert found.after < 1.3 * found.noise_floor


def test_a_nominal_stepper_has_no_gap() -> None:
    found = diagnose([stepper_session({})], [], nominal())
    assert found.verdict == []


def test_a_stepper_twin_that_has_the_effects_has_no_gap() -> None:
    found = diagnose([stepper_session(EFFECTS)], [], nominal().with_effects(EFFECTS))
    assert found.verdict == []
    assert found.before < 1.4 * SCATTER


def test_the_reference_stands_in_for_a_missing_count() -> None:
    session = stepper_session(EFFECTS)
    series = {k: s for k, s in session.series.items() if k != topics.JOINT_STATES}
    found = diagnose([replace(session, series=series)], [], nominal())
    assert set(found.verdict) == set(EFFECTS)


def encoded(effects: dict[str, dict[str, float]]) -> Session:
    """The session of a stage with an encoder of 50 nm in place of a tracker."""
    session = stepper_session(effects)
    points = session.series[topics.TRACKER_POINT]
    read = {f'position.{a}': np.rint(points.values[a] / 5e-8) * 5e-8 for a in 'xy'}
    states = Series(topics.JOINT_STATES, points.stamps, read)
    return replace(
        session,
        series={topics.REFERENCE: session.series[topics.REFERENCE], topics.JOINT_STATES: states},
    )


def test_an_encoder_measures_where_there_is_no_tracker() -> None:
    found = diagnose([encoded(EFFECTS)], [], nominal())
    assert set(found.verdict) == set(EFFECTS)
    assert found.parameters['backlash.y']['width'][0] == pytest.approx(8e-6, rel=0.15)
    assert found.after < 1.4 * SCATTER < 0.5 * found.before
    assert any('the encoder measures in its place' in text for text in found.warnings)
    assert diagnose([encoded({})], [], nominal()).verdict == []


def test_what_a_stepper_session_may_lack() -> None:
    session = stepper_session({})
    without = {k: s for k, s in session.series.items() if k != topics.TRACKER_POINT}
    with pytest.raises(StageError, match='are the counted steps'):
        diagnose([replace(session, series=without)], [], nominal())
    with pytest.raises(StageError, match='rests'):
        diagnose([stepper_session({}, moves=10)], [], nominal())


MANY = {
    **EFFECTS,
    'scale_error.y': {'error': -80e-6},
    'backlash.x': {'width': 8e-6},
    'nonorthogonality': {'angle': -190e-6},
}


def known_scatter() -> TwinFile:
    return replace(nominal(), repeatability=4.0 * SCATTER)


def test_many_effects_are_named_from_few_rests() -> None:
    found = diagnose([stepper_session(MANY, moves=32)], [], known_scatter())
    assert set(found.verdict) == set(MANY)
    assert found.after < 1.5 * found.noise_floor


def test_many_effects_are_named_where_nobody_states_the_scatter() -> None:
    many = {
        **MANY,
        'cyclic_pitch_error.x': {'amplitude': 2e-6, 'phase': 0.4},
        'straightness.x': {'quadratic': 3e-6},
    }
    found = diagnose([stepper_session(many, moves=72)], [], nominal())
    # The mean of a straightness over a part of its range is an offset of the tracker.
    assert set(many) <= set(found.verdict) <= {*many, 'tracker_misalignment'}
    assert found.after < 1.5 * SCATTER


def test_what_too_few_rests_leave_is_unknown_and_no_noise() -> None:
    found = diagnose([stepper_session(MANY, moves=20)], [], known_scatter())
    assert 'unknown' in found.verdict
    assert found.after > 1.5 * found.noise_floor


def test_repeatability_is_that_of_repeated_rests() -> None:
    generator = np.random.default_rng(3)
    stops = np.array([[0.0, 0.0], [0.02, 0.01], [0.04, 0.03], [0.01, 0.005]])
    where = np.tile(stops, (30, 1))
    point = where + 2e-6 * generator.standard_normal(where.shape)
    side = np.sign(np.diff(where, axis=0, prepend=where[:1]))
    rests = _Rests(np.arange(120.0), point, np.ones(120), where, side, 1e-6)
    assert _repeats(rests, np.full(2, 5e-8)) == pytest.approx(2e-6, rel=0.15)
    few = _Rests(*(field[:4] for field in (rests.time, point, rests.count, where, side)), 1e-6)
    assert _repeats(few, np.full(2, 5e-8)) is None


def test_the_side_of_an_approach_is_that_of_the_last_motion() -> None:
    """A place above the last rest that is overshot by 20 µm is approached from above."""
    path = np.array([0.0, 0.0, 0.01, 0.02, 0.02002, 0.02001, 0.02, 0.02, 0.02, 0.03, 0.03])
    other = np.where(np.arange(len(path)) > 8, 0.001, 0.0)
    found = sides(np.column_stack([path, other]))
    assert found[:, 0].tolist() == [0, 0, 1, 1, 1, -1, -1, -1, -1, 1, 1]
    assert found[:, 1].tolist() == [0] * 9 + [1, 1]


def test_a_count_and_an_encoder_of_one_controller_are_judged_in_motion() -> None:
    """A slow stroke one way without a rest, both read in one tick (a real rotary axis)."""
    time = np.arange(0.0, 60.0, 0.01)
    motor = 0.0005 * time
    table = motor + 20e-6 * np.sin(2.0 * np.pi * motor / 0.007)
    table = 1e-7 * np.rint((table + 1e-7 * np.random.default_rng(1).normal(size=6000)) / 1e-7)
    stamps = START + np.rint(1e9 * time).astype(np.int64)
    zeros = np.zeros(len(time))
    series = {
        topic: Series(topic, stamps, {'position.x': motor})
        for topic in (topics.REFERENCE, topics.JOINT_STATES)
    }
    points = {'x': table, 'y': zeros, 'z': zeros}
    series[topics.TRACKER_POINT] = Series(topics.TRACKER_POINT, stamps, points)
    twin = TwinFile('stepper', {'x': StepperAxis()}, 0.01, tracker=TrackerSpec(100.0, 1e-7))
    found = diagnose([Session('stroke', series)], [], twin)
    assert found.verdict == ['cyclic_pitch_error.x']
    own = found.parameters['cyclic_pitch_error.x']
    assert own['period'][0] == pytest.approx(0.007, rel=0.01)
    assert own['amplitude'][0] == pytest.approx(20e-6, rel=0.05)
    # A tracker with a clock of its own says nothing of a stage that moves.
    late = replace(series[topics.TRACKER_POINT], stamps=stamps + 3_000_000)
    with pytest.raises(StageError, match='rests'):
        diagnose([Session('stroke', {**series, topics.TRACKER_POINT: late})], [], twin)
