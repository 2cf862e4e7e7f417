"""Costs of the stage driver: a control tick, the Zaber codec, a cycle over the emulated chain.

nice -n 10 .venv/bin/python benchmarks/bench_driver.py
"""

from __future__ import annotations

import time

import numpy as np

from stage_core.twin_file import StepperAxis, TwinFile
from stage_driver.config import ServoConfig, ZaberConfig
from stage_driver.limits import AxisLimits
from stage_driver.protocol import decode_answer, encode_command
from stage_driver.servo_axes import ServoAxes
from stage_driver.zaber_stage import ZaberStage
from stage_twin.emulators.zaber import ZaberChain
from stage_twin.emulators.zaber_pty import ZaberPty
from stage_twin.stepper import StepperPlant

LIMITS = AxisLimits(0.0, 0.05, 0.1, 1.0, 1.0)


def control_ticks(count: int = 20000) -> np.ndarray:
    """Durations [s] of control ticks of two axes during a move."""
    limits = (AxisLimits(-10.0, 10.0, 0.2, 2.0, 4.0),) * 2
    axes = ServoAxes(ServoConfig(('x', 'y'), limits, TwinFile.nominal_servo()))
    axes.motion.move(np.array([4.0, 2.0]), axes.motion.max_velocity, axes.encoder)
    durations = np.empty(count)
    for k in range(count):
        begin = time.perf_counter()
        axes.measure(axes.motion.reference)
        axes.control()
        durations[k] = time.perf_counter() - begin
    return durations


def codec(count: int = 20000) -> tuple[float, float]:
    """Mean durations [s] of encoding a command and decoding a reply."""
    begin = time.perf_counter()
    for number in range(count):
        encode_command('move abs 104987 34402 3440', 1, 1, number % 100)
    middle = time.perf_counter()
    for _ in range(count):
        decode_answer(b'@01 1 07 OK BUSY -- 104987:00'[:-3])
    return (middle - begin) / count, (time.perf_counter() - middle) / count


def polls(count: int = 500) -> np.ndarray:
    """Durations [s] of a poll of two axes over the emulated chain on a pseudo-terminal."""
    twin = TwinFile(kind='stepper', axes={'x': StepperAxis(), 'y': StepperAxis()})
    with ZaberPty(ZaberChain(StepperPlant(twin))) as server:
        stage = ZaberStage(ZaberConfig(('x', 'y'), (LIMITS, LIMITS), server.port))
        durations = np.empty(count)
        for k in range(count):
            begin = time.perf_counter()
            stage.poll()
            durations[k] = time.perf_counter() - begin
        stage.close()
    return durations


def row(name: str, durations: np.ndarray) -> None:
    """Print median and percentiles in microseconds."""
    median, high, worst = np.percentile(durations * 1e6, (50, 99, 100))
    print(f'{name:34s} median {median:8.1f} µs   99 % {high:8.1f} µs   worst {worst:9.1f} µs')


def main() -> None:
    """Print the table."""
    row('servo control tick, two axes', control_ticks())
    encoding, decoding = codec()
    print(f'{"encode a Zaber command":34s} mean   {encoding * 1e6:8.1f} µs')
    print(f'{"decode a Zaber reply":34s} mean   {decoding * 1e6:8.1f} µs')
    row('poll of two Zaber axes (emulated)', polls())


if __name__ == '__main__':
    main()
