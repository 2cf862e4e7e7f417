"""What the noise of an encoder does to a loop that sticks.

The controller answers the noise of each reading with a force, and an axis that is shaken creeps
where one without noise stands still (dither: Armstrong-Hélouvry, Dupont and Canudas de Wit, "A
survey of models, analysis tools and compensation methods for the control of machines with
friction", Automatica 30, 1994). So a twin with a friction is run with draws of the noise that was
measured, or of that with which it rests as the machine does (`rests`). What the loop without
effects answers to the same draw is no gap, and is taken out again.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace
from functools import lru_cache

import numpy as np

from gap_diagnosis.evidence.describe import model_of
from gap_diagnosis.input.data import Record
from gap_diagnosis.input.noise import AxisNoise
from stage_core.arrays import Array
from stage_core.twin_file import ServoAxis, TwinFile
from stage_twin.effects.shared import filtered
from stage_twin.simulate import simulate_loop

Axes = tuple[tuple[str, ServoAxis], ...]

#: Step [m] of an encoder that does not round.
STEPLESS = 1e-12
#: Draws and answers that are kept: four of both axes together and of each alone, with two noises,
#: of two sessions.
KEPT = 48


def sticks(effects: Iterable[str]) -> bool:
    """Whether one of the effects is a friction that holds an axis at rest."""
    return any(model_of(name) == 'friction' for name in effects)


def shakes(record: Record) -> bool:
    """Whether the loop is run with noise."""
    return any(_noise(record))


def shaking(record: Record, twin: TwinFile, draw: int = 0) -> Array:
    """Velocity commands (n, a) [m/s] that do to the loop what the noise of its readings does.

    The controller takes a reading for its position error, and by its filtered difference for the
    velocity (interfaces.md, "Servo controller").
    """
    return _shaking(*_loop(record, twin), draw)


def answer(record: Record, twin: TwinFile, draw: int = 0) -> tuple[Array, Array]:
    """Positions [m] and forces [N], each (n, a), of the loop without effects to `shaking`."""
    return _answer(*_loop(record, twin), draw)


def _loop(record: Record, twin: TwinFile) -> tuple[Axes, tuple[float, ...], int, float]:
    """All that a draw hangs on: axes, noise of each [m], number of ticks and their period [s]."""
    axes = {a: replace(twin.servo(a), encoder_resolution=STEPLESS) for a in record.axes}
    return tuple(axes.items()), _noise(record), len(record.time), record.period


def _noise(record: Record) -> tuple[float, ...]:
    """Standard deviation [m] of the noise of each encoder with which the loop is run."""
    if record.noise is None:
        return (0.0,) * len(record.axes)
    return tuple(
        _beyond_steps(own) if own.at_rest is None else own.at_rest for own in record.noise.axes
    )


def _beyond_steps(own: AxisNoise) -> float:
    """Standard deviation [m] of what an encoder's noise is more than that of its steps."""
    beyond = max(own.position**2 - own.quantum**2 / 12.0, 0.0)
    return math.sqrt(beyond) if own.beyond_steps else 0.0


@lru_cache(maxsize=KEPT)
def _shaking(axes: Axes, noise: tuple[float, ...], count: int, period: float, draw: int) -> Array:
    out = np.zeros((count, len(axes)))
    for column, (name, axis), std in zip(out.T, axes, noise, strict=True):
        # An axis has the same draw alone and beside another one.
        reading = std * np.random.default_rng(256 * draw + ord(name)).standard_normal(count)
        reading[0] = 0.0
        keep = math.exp(-period * axis.velocity_filter)
        speed = filtered([1.0 - keep], [1.0, -keep], np.diff(reading, prepend=0.0) / period)
        column[:] = -axis.position_gain * reading - speed
    return out


@lru_cache(maxsize=KEPT)
def _answer(
    axes: Axes, noise: tuple[float, ...], count: int, period: float, draw: int
) -> tuple[Array, Array]:
    still = np.zeros((count, len(axes)))
    machine = TwinFile('servo', dict(axes), control_period=period)
    return simulate_loop(machine, still, still, _shaking(axes, noise, count, period, draw))
