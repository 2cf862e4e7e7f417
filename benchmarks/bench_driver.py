"""Costs of the stage driver: a control tick, the Zaber codec, a cycle over the emulated chain.

nice -n 10 .venv/bin/python benchmarks/bench_driver.py
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks.paced_wire import PacedWire
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
BAUD = 115200


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


@contextmanager
def on_a_wire() -> Iterator[tuple[ZaberStage, PacedWire]]:
    """Two homed axes of the emulated chain, behind a line that takes the time of its bits."""
    twin = TwinFile(kind='stepper', axes={'x': StepperAxis(), 'y': StepperAxis()})
    with ZaberPty(ZaberChain(StepperPlant(twin))) as server:
        wire = PacedWire(server.port, BAUD)
        stage = ZaberStage(ZaberConfig(('x', 'y'), (LIMITS, LIMITS), wire.port))
        stage.home()
        while (poll := stage.poll()) is None or any(poll.busy):
            time.sleep(0.02)
        try:
            yield stage, wire
        finally:
            stage.close()
            wire.close()


def exchanges(wire: PacedWire, exchange: Callable[[int], object], count: int) -> np.ndarray:
    """Durations of an exchange and the wire's own time for it [s], a row for each."""
    durations = np.empty((count, 2))
    for k in range(count):
        wire.lines.clear()
        begin = time.perf_counter()
        exchange(k)
        durations[k, 0] = time.perf_counter() - begin
        time.sleep(0.002)
        durations[k, 1] = wire.own_time()
    return durations


def on_the_wire(count: int = 300) -> None:
    """Print what a poll and a streamed move of two axes take at the rate of the wire."""
    with on_a_wire() as (stage, wire):
        ways = {
            'poll': lambda _: stage.poll(),
            'move': lambda k: stage.stream((0.001 + 1e-6 * k,) * 2, (k, k)),
        }
        for name, exchange in ways.items():
            durations = exchanges(wire, exchange, count)
            row(f'{name} of two axes at {BAUD} baud', durations[:, 0])
            own = durations[:, 1]
            over = durations[:, 0] / own - 1.0
            print(
                f'  the wire itself {1e3 * np.median(own):.2f} ms; beyond it '
                f'median {np.median(over):.1%}, 99 % {np.percentile(over, 99):.1%}'
            )


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
    on_the_wire()


if __name__ == '__main__':
    main()
