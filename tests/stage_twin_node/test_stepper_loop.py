"""The stepper behind its terminal: exchanges let virtual time pass, and the tracker watches."""

import time

import pytest
import serial

from stage_core.clocks import LOCKSTEP_EXCHANGE
from stage_core.twin_file import StepperAxis
from stage_twin.loops import LOCKSTEP_START_NS
from stage_twin.stepper_loop import StepperLoop

from ..patience import wait
from ..points import TWIN, PointRecorder

MICROSTEP = StepperAxis().microstep


def exchange(port, line):
    port.write(line + b'\n')
    answer = port.readline()
    assert answer.startswith(b'@'), answer
    return answer


def run(tmp_path):
    recorder, clock = PointRecorder(), []
    loop = StepperLoop(TWIN, recorder, 4, True, str(tmp_path / 'zaber'), clock.append)
    loop.start()
    try:
        with serial.Serial(str(tmp_path / 'zaber'), 115200, timeout=30.0) as port:
            exchange(port, b'/1 home')
            exchange(port, b'/2 home')
            for _ in range(20):
                exchange(port, b'/1')
            assert b' OK ' in exchange(port, b'/1 move abs 20000')
            for _ in range(200):
                answer = exchange(port, b'/1 get pos')
        assert answer.split()[-1] == b'20000'
        level, _, values = loop.status()
        assert (level, values['dropped_lines']) == (0, 0)
        assert loop.reset()
    finally:
        loop.stop()
    assert not (tmp_path / 'zaber').is_symlink()
    return recorder.points, clock


def test_lockstep_is_deterministic_and_the_tracker_sees_the_move(tmp_path):
    first, clock = run(tmp_path)
    second, _ = run(tmp_path)
    assert first == second
    times = [stamp for stamp, _ in first]
    assert times[0] == LOCKSTEP_START_NS
    assert {b - a for a, b in zip(times, times[1:], strict=False)} == {10_000_000}
    assert clock == sorted(clock)
    assert {(b - a) for a, b in zip(clock, clock[1:], strict=False)} <= {0, LOCKSTEP_EXCHANGE}
    # 20 000 microsteps; the repeatability is 3 µm wide and the noise 1 µm.
    assert first[-1][1][0] == pytest.approx(20000 * MICROSTEP, abs=8e-6)
    assert abs(first[-1][1][1]) < 8e-6


def test_real_time_samples_at_the_trackers_rate():
    recorder = PointRecorder()
    begin = time.time_ns()
    loop = StepperLoop(TWIN, recorder, noise=False)
    loop.start()
    try:
        wait(lambda: len(recorder.points) >= 30)
    finally:
        loop.stop()
    stamps = [stamp for stamp, _ in recorder.points]
    assert stamps == sorted(set(stamps))
    assert begin <= stamps[0]
