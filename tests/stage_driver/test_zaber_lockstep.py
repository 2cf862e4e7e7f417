"""The Zaber backend in lockstep with the emulated chain: the same requests, the same session."""

import random
import time
from contextlib import contextmanager

from stage_core.clocks import LOCKSTEP_EXCHANGE, NANOSECONDS
from stage_driver.config import ZaberConfig
from stage_driver.states import State
from stage_driver.zaber_lockstep import LockstepZaberBackend
from stage_twin.loops import LOCKSTEP_START_NS
from stage_twin.stepper_loop import StepperLoop

from ..patience import wait
from ..points import TWIN, PointRecorder
from .driver_rig import Recorder
from .zaber_rig import LIMITS

SETTLE = 0.2
TICK = 20_000_000
AXES = ['x', 'y']


@contextmanager
def lockstep(folder, points, told):
    """A homed backend and what it publishes; `told` is called with the time of the chain."""
    recorder, link = Recorder(), str(folder / 'zaber')
    loop = StepperLoop(TWIN, points, 4, True, link, told)
    loop.start()
    config = ZaberConfig(
        ('x', 'y'), (LIMITS, LIMITS), link, settle_time=SETTLE, lockstep_timeout=60.0
    )
    backend = LockstepZaberBackend(config, recorder, LOCKSTEP_START_NS)
    backend.start()
    try:
        wait(lambda: recorder.states)
        backend.home().result()
        yield backend, recorder
    finally:
        backend.close()
        loop.stop()


def run(folder, pauses):
    """Home, a move, the same place again, and a stream of 30 ticks with pauses in between."""
    points, clock = PointRecorder(), []

    def idle():
        return backend.status().state is State.READY and not backend._due()

    def submit(stamp, positions, velocities):
        taken = backend._last_setpoint
        backend.submit(stamp, AXES, positions, velocities)
        wait(lambda: backend._last_setpoint is not taken)

    with lockstep(folder, points, clock.append) as (backend, recorder):
        ends = []
        for number, target in enumerate(([0.01, 0.004], [0.01, 0.004]), 1):
            time.sleep(pauses.random() * 0.02)
            submit(number, target, [])
            # A set-point that is sent again for safety changes nothing.
            backend.submit(number, AXES, target, [])
            wait(idle)
            ends.append(backend._last.stamp)
        for tick in range(30):
            seen = backend._last.stamp
            time.sleep(pauses.random() * 0.005)
            submit(seen, [0.01 + 1e-4 * tick, 0.004], [0.005, 0.0])
            wait(lambda seen=seen: backend._last.stamp > seen)
        stamps = [stamp for stamp, *_ in recorder.states]
        submit(99, [0.013, 0.004], [])
        wait(idle)
        assert backend._clock.now() == clock[-1]
    assert not [text for level, text in recorder.events if level], recorder.events
    return recorder, points.points, stamps, ends


def test_two_runs_are_identical(tmp_path):
    results = []
    for number in range(2):
        folder = tmp_path / str(number)
        folder.mkdir()
        results.append(run(folder, random.Random(number)))
    (first, points, stamps, ends), (second, others, *_) = results
    # Closing stops the axes, when the last answers are no longer waited for.
    length = min(len(points), len(others))
    assert length > 100 and points[:length] == others[:length]
    assert first.states == second.states and first.controls == second.controls
    assert first.temperatures == second.temperatures
    # The ticks of a stream are whole ones.
    ticks = [late - early for early, late in zip(stamps[-30:], stamps[-29:], strict=False)]
    assert {gap % TICK for gap in ticks} == {0} and ticks.count(TICK) >= 25
    # The move ends SETTLE after the last change that was published; so does one of no length.
    states = {stamp: position for stamp, position, _ in first.states}
    end = ends[0]
    moved = max(s for s in states if s <= end and states[s] != states[end])
    settle = round(SETTLE * NANOSECONDS)
    assert settle <= end - moved <= settle + 4 * LOCKSTEP_EXCHANGE
    assert settle <= ends[1] - end <= settle + 8 * LOCKSTEP_EXCHANGE


def test_a_stopped_stream_stays_stopped_for_the_wall_time_of_lockstep(tmp_path):
    with lockstep(tmp_path, PointRecorder(), lambda now: None) as (backend, recorder):
        seen = backend._last.stamp
        backend.submit(seen, AXES, [], [0.02, 0.0])
        wait(lambda: backend._last.stamp > seen)
        backend.submit(seen, AXES, [], [float('nan'), 0.0])
        wait(lambda: backend.status().state is State.READY and not backend._due())
        # A slow sender: longer than `setpoint_timeout`, which counts in real time alone.
        time.sleep(2.0 * backend.config.setpoint_timeout)
        backend.submit(backend._last.stamp, AXES, [], [0.02, 0.0])
        wait(lambda: recorder.said('pause it for 60') or backend._streaming)
        assert not backend._streaming
