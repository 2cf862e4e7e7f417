"""The course of a run against a small plant whose velocity loop is perfect."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from contour_ctrl import curves, reference, storage, timed
from contour_ctrl.excitation import excitation
from contour_ctrl.feedrate import AxisLimits
from contour_ctrl.learning import Learner, LearningSettings
from contour_ctrl.sequence import REST_TIME, ContourRun, Phase, RunSettings, SetPoint
from contour_ctrl.tick import Controller, Gains
from stage_core.errors import StageError

MS = 1_000_000
GAINS = Gains((40.0, 40.0), (0.9, 0.8))
REFERENCE = reference.plan(curves.circle(0.005, (0.01, 0.0)), 0.03)


class Stage:
    """Follows velocities exactly and position moves at once; counts of 0.1 µm."""

    def __init__(self) -> None:
        self.q = np.array([0.004, -0.003])
        self.stamp = 10_000 * MS
        self.velocity = np.zeros(2)
        self.sent: list[SetPoint] = []

    def take(self, point: SetPoint | None) -> None:
        if point is None:
            return
        self.sent.append(point)
        if point.velocity is None:
            self.q = np.array(point.position)
            self.velocity = np.zeros(2)
        else:
            self.velocity = np.array(point.velocity)

    def step(self, run: ContourRun) -> None:
        reading = np.round(self.q * 1e7) / 1e7
        self.take(run.on_state(self.stamp, *reading))
        self.q = self.q + 1e-3 * self.velocity
        self.stamp += MS

    def drive(self, run: ContourRun, ticks: int = 100_000) -> None:
        for _ in range(ticks):
            if run.done:
                return
            self.step(run)


def learner() -> Learner:
    return Learner(len(REFERENCE), 1e-3, LearningSettings(gain=(30.0, 30.0)))


def test_iterations_learn_and_end_with_a_position() -> None:
    stage = Stage()
    seen: list[int] = []
    run = ContourRun(
        Controller(REFERENCE, GAINS), learner(), 6, report=lambda index, _: seen.append(index)
    )
    stage.take(run.begin(stage.stamp))
    stage.drive(run)
    assert run.success and seen == [1, 2, 3, 4, 5, 6]
    assert run.results[-1].x.rms < 0.2 * run.results[0].x.rms
    assert 'first: tracking RMS' in run.message and 'best, iteration' in run.message
    assert stage.sent[0].velocity is None and stage.sent[-1].velocity is None
    assert stage.sent[-1].position == pytest.approx(tuple(REFERENCE.position[-1]))
    streams = [point for point in stage.sent if point.velocity is not None]
    assert len(streams) == 6 * len(REFERENCE)
    assert [p.stamp for p in stage.sent] == sorted({p.stamp for p in stage.sent})
    assert run.missed == 0


def test_a_motion_without_a_path_is_off_by_no_more_than_its_tracking_error() -> None:
    turn = np.linspace(0.0, 1.0, 201)
    angle = 2.0 * np.pi * turn**3 * (10.0 - 15.0 * turn + 6.0 * turn**2)
    x, y = 0.01 * np.cos(angle), 0.01 * np.sin(angle)
    rows = [','.join(map(str, row)) for row in np.column_stack([8.0 * turn, x, y])]
    motion = timed.from_text('\n'.join(['t,x,y', *rows]), 'a table', 1e-3, AxisLimits())
    stage = Stage()
    run = ContourRun(Controller(motion, replace(GAINS, cross_coupling=20.0)), None, 1)
    stage.take(run.begin(stage.stamp))
    stage.drive(run)
    (result,) = run.results
    # Measured: contour 13 µm, tracking x 33 µm and y 74 µm.
    assert 0.0 < result.contour.max <= np.hypot(result.x.max, result.y.max) < 1e-4


def test_lockstep_starts_at_the_last_tick_seen_when_the_world_is_quiet() -> None:
    stage = Stage()
    run = ContourRun(Controller(REFERENCE, GAINS), None, 1, RunSettings(lockstep=True))
    stage.take(run.begin(stage.stamp))
    stage.drive(run, 150)
    assert run.waits_for_quiet and run.phase is Phase.APPROACH
    first = run.world_is_quiet()
    assert first is not None and first.velocity is not None
    assert first.stamp == stage.stamp - MS
    assert first.position == pytest.approx(tuple(REFERENCE.position[0]))


def test_in_real_time_a_contour_starts_once_the_move_to_its_start_is_forgotten() -> None:
    stage = Stage()
    run = ContourRun(Controller(REFERENCE, GAINS), None, 1)
    stage.take(run.begin(stage.stamp))
    stage.step(run)
    # A stage that still creeps by more than REST_MOTION does not rest.
    stage.drive(run, 400)
    stage.q = stage.q + 7e-6
    creeps = stage.stamp
    while run.phase is Phase.APPROACH:
        stage.step(run)
    assert stage.sent[-1].stamp == creeps + round(REST_TIME * 1000) * MS


def half_a_second_on(taught: Learner | None, iterations: int) -> tuple[Stage, ContourRun]:
    """A stage that has followed its contour for 500 ticks."""
    stage = Stage()
    run = ContourRun(Controller(REFERENCE, GAINS), taught, iterations)
    stage.take(run.begin(stage.stamp))
    while run.phase is not Phase.STREAM or run.tick < 500:
        stage.step(run)
    return stage, run


def test_abort_stays_on_the_contour_and_comes_to_rest() -> None:
    stage, run = half_a_second_on(learner(), 3)
    begin = len(stage.sent)
    run.abort()
    stage.drive(run)
    assert not run.success and run.message == 'aborted by request'
    stop = [p for p in stage.sent[begin:] if p.velocity is not None]
    assert len(stop) == pytest.approx(200, abs=2)
    radius = [np.hypot(p.position[0] - 0.01, p.position[1]) for p in stop]
    assert radius == pytest.approx([0.005] * len(stop), abs=1e-6)
    speed = np.array([np.hypot(*p.velocity) for p in stop if p.velocity])
    assert speed[-1] < 2e-3 and np.abs(np.diff(speed)).max() < 1e-3
    assert stage.sent[-1].velocity is None


def test_abort_before_the_start_holds_the_stage_where_it_is() -> None:
    stage = Stage()
    run = ContourRun(Controller(REFERENCE, GAINS), None, 1)
    run.begin(stage.stamp)
    run.on_state(stage.stamp, 0.004, -0.003)
    held = run.abort()
    assert held is not None and held.position == (0.004, -0.003) and run.done


def test_nan_and_silence_end_the_run_where_the_stage_can_brake() -> None:
    stage, run = half_a_second_on(None, 1)
    point = run.on_state(stage.stamp, float('nan'), 0.0)
    assert run.done and 'not a number' in run.message
    assert point is not None and point.velocity is None
    ahead = np.array(point.position) - REFERENCE.position[500]
    assert ahead == pytest.approx(0.1 * REFERENCE.velocity[500], abs=2e-4)
    assert 'no encoder message on /stage/joint_states for 0.6 s' in run.silence(0.6)


def test_a_start_that_is_not_reached_is_told() -> None:
    run = ContourRun(Controller(REFERENCE, GAINS), None, 1, RunSettings(approach_timeout=0.5))
    run.begin(0)
    for k in range(600):
        run.on_state(k * MS, 0.0, 0.0)
    assert run.done and '15.000 mm are left' in run.message


def test_missed_ticks_are_counted_bridged_or_refused() -> None:
    for every, fine in ((50, True), (5, False)):
        stage = Stage()
        run = ContourRun(Controller(REFERENCE, GAINS), learner(), 1)
        stage.take(run.begin(stage.stamp))
        count = 0
        while not run.done:
            count += 1
            if run.phase is Phase.STREAM and count % every == 0:
                stage.q = stage.q + 1e-3 * stage.velocity
                stage.stamp += MS
            else:
                stage.step(run)
        assert run.success == fine
        assert run.missed > 10
        if not fine:
            assert 'had no encoder message in time' in run.message
            # At once, not after an iteration that cannot be learned from.
            assert run.tick < 0.3 * len(REFERENCE)


@pytest.mark.parametrize(('lost', 'goes_on'), [(30, True), (40, False)])
def test_a_step_that_the_driver_would_call_a_fault_ends_the_stream(
    lost: int, goes_on: bool
) -> None:
    # 30 mm/s: 1 mm, the default of longest_step, is 33 ticks.
    stage, run = half_a_second_on(None, 1)
    stage.stamp += lost * MS
    stage.step(run)
    assert run.done != goes_on
    if goes_on:
        assert run.missed == lost and run.tick == 500 + lost + 1
        return
    assert '40 ticks in a row had no encoder message, 1.2 mm of the contour' in run.message
    # The driver stops a stream that ends: a move would start again what it has stopped by now.
    assert stage.sent[-1].velocity is not None


def test_same_course_at_fifty_hertz() -> None:
    slow = reference.plan(curves.circle(0.005, (0.01, 0.0)), 0.005, period=0.02)
    run = ContourRun(Controller(slow, Gains((5.0, 5.0))), None, 1)
    stage = Stage()
    stage.take(run.begin(stage.stamp))
    for _ in range(100_000):
        if run.done:
            break
        reading = np.round(stage.q * 1e7) / 1e7
        stage.take(run.on_state(stage.stamp, *reading))
        stage.q = stage.q + 0.02 * stage.velocity
        stage.stamp += 20 * MS
    assert run.success and run.results[0].contour.max < 2e-5


def test_learned_signals_belong_to_a_contour_and_a_machine(tmp_path: Path) -> None:
    of = REFERENCE.digest(), 'stage-1'
    path = storage.file_of(tmp_path / 'session', *of, 'cccmac+rilc')
    signal = np.random.default_rng(0).normal(size=(50, 2))
    kept = storage.Learned(*of, signal, np.ones((8, 5, 5)))
    storage.save(path, kept, {'scheme': 'cccmac+rilc'})
    back = storage.load(path, *of)
    assert np.array_equal(back.signal, signal) and back.weights.shape == (8, 5, 5)
    other = reference.plan(curves.circle(0.005, (0.01, 0.0)), 0.031)
    with pytest.raises(StageError, match='another contour'):
        storage.load(path, other.digest(), 'stage-1')
    assert storage.file_of(path.parent, other.digest(), 'stage-1', 'cccmac+rilc') != path
    assert storage.file_of(path.parent, *of, 'ccc') != path
    with pytest.raises(StageError, match='another contour or machine'):
        storage.load(path, REFERENCE.digest(), 'stage-2')
    path.write_bytes(path.read_bytes()[:300])
    with pytest.raises(StageError, match='holds no learned signal'):
        storage.load(path, REFERENCE.digest(), 'stage-1')
    with pytest.raises(StageError, match='nothing is learned yet'):
        storage.load(tmp_path / 'absent.npz', *of)


def test_what_is_learned_outlives_a_correction_of_the_contour() -> None:
    moved = REFERENCE.corrected(lambda points: 1.0001 * points)
    assert np.abs(moved.position - REFERENCE.position).max() > 1e-7
    assert moved.digest() == moved.corrected(lambda points: points + 1e-6).digest()
    assert moved.digest() == REFERENCE.digest()


def test_excitation_is_consistent_and_stays_within_its_limits() -> None:
    limits = AxisLimits((0.2, 0.2), (2.0, 2.0), (500.0, 500.0))
    ref = excitation((0.03, 0.02), (0.01, 0.0), (0.004, 0.05), 6.0, limits=limits)
    moved = np.diff(ref.position, axis=0) / ref.period
    middle = 0.5 * (ref.velocity[1:] + ref.velocity[:-1])
    assert np.abs(moved - middle).max() < 1e-4
    reach = np.abs(ref.position - (0.01, 0.0)).max(axis=0)
    assert reach[0] <= 0.03 + 1e-9 and reach[1] <= 0.02 + 1e-9
    assert np.abs(ref.acceleration).max() <= 2.0
    assert ref.position[[0, -1]] == pytest.approx(np.array([[0.01, 0.0]] * 2), abs=1e-6)
    assert np.abs(ref.velocity[[0, -1]]).max() < 1e-4
    with pytest.raises(StageError, match='speed limit of axis x'):
        excitation((0.05, 0.05), speeds=(0.3,), limits=limits)


COMPILED_IN_TIME = """
from contour_ctrl import contour_error, sequence, tick
from tests.contour_ctrl import test_sequence as small

kernels = (tick.tick, contour_error.estimates)
assert not any(kernel.signatures for kernel in kernels)
sequence.compile_kernels()
ready = [len(kernel.signatures) for kernel in kernels]
assert all(ready)
stage = small.Stage()
controller = small.Controller(small.REFERENCE, small.GAINS)
run = sequence.ContourRun(controller, small.learner(), 2)
stage.take(run.begin(stage.stamp))
stage.drive(run)
assert run.success
assert [len(kernel.signatures) for kernel in kernels] == ready
"""


def test_nothing_is_compiled_while_a_contour_runs() -> None:
    root = Path(__file__).resolve().parents[2]
    subprocess.run([sys.executable, '-c', COMPILED_IN_TIME], cwd=root, check=True)
