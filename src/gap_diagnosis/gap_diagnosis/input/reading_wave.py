"""A wave that an encoder reads over its own position, told without a tracker.

Where an axis passes the wave faster than its loop can follow, the reading holds all of it beside
a smooth path. A force of the position would move the mass the less the faster it is passed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.parameters import Estimates
from gap_diagnosis.residuals.low_pass import band_limited
from gap_diagnosis.residuals.operators import central_difference
from stage_core.arrays import Array
from stage_twin.effects import periodic
from stage_twin.effects.encoder_interpolation import (
    EFFECT,
    LONGEST,
    SHORTEST,
    STEPS,
    TRAVELLED,
    misreading,
    peaks,
)

Mask = NDArray[np.bool_]

MISREADS = EFFECT.name

#: Hz, up to which the motion is, and times as fast as which a wave is passed.
MOTION, FASTER = 30.0, 1.5
#: Mean square that a force's wave leaves of what is fast in a reading, over that which a read wave
#: leaves: 1.7 to 7.5 on seven axes whose encoders err (1.0 to 1.2 on three of smaller waves), and
#: 1.07 at most on 510 others of five foreign simulators, rounding apart, which the next rule keeps
#: out.
RATHER = 1.4
#: Least amplitude over that of the rounding's own wave (step / pi), which reached 0.95.
LEAST_STEPS = 2.0
#: Share of the amplitude by which the loop's answer to the wave moves what is found of it: on the
#: three axes whose wave explained most, amplitudes were -3 to +5 % off.
ANSWER = 0.06
FEWEST = 500  # ticks
EDGE = 0.2  # s at the ends, where the low-pass has no path
ROUNDS, SMALL = 4, 1e-3
#: Steps from a reading to the motion behind it. Each leaves 2 pi amplitude / period of the error.
BEHIND = 3
NEAR = np.linspace(-0.5, 0.5, 11)  # turns over the travel about a peak


@dataclass(frozen=True)
class _Passed:
    """Ticks (n,) at which a spatial frequency [1/m] is passed fast: their place [m], speed [m/s].

    `fast` is what the reading has beside its path [m].
    """

    frequency: float
    path: Array
    speed: Array
    fast: Array

    def left(self, frequency: float, force: bool = False) -> float:
        """Share of the squared remainder that a wave leaves, read or made by a force."""
        matrix = np.column_stack(periodic.waves(self.path, frequency, 2))
        if force:
            matrix /= self.speed[:, None] ** 2
        found, *_ = np.linalg.lstsq(matrix, self.fast, rcond=None)
        left = self.fast - matrix @ found
        return float(left @ left) / float(self.fast @ self.fast)


def without_wave(position: Array, period: float, values: Mapping[str, float]) -> Array:
    """Motor positions (n,) [m] behind readings of an encoder with a wave of these parameters."""
    motor = position
    for _ in range(BEHIND):
        motor = position - misreading(band_limited(motor, period, MOTION), values)
    return motor


def inner_ticks(whole: Mask, period: float) -> Mask:
    """Those of the ticks (n,) of a period [s] that are no ends of a session."""
    inner, edge = whole.copy(), round(EDGE / period)
    inner[:edge] = inner[-edge:] = False
    return inner


def reading_wave(position: Array, period: float, whole: Mask, quantum: float) -> Estimates:
    """Parameters of `encoder_interpolation` with standard deviations; empty where none shows.

    Parameters
    ----------
    position : (n,) of an encoder on the ticks of a control period [s], in m
    quantum : step of the encoder [m]
    whole : (n,) ticks that are far from lost ones
    """
    path = band_limited(position, period, MOTION)
    speed = np.abs(central_difference(path, period))
    travel = float(np.ptp(path))
    low = max(1.0 / LONGEST, TRAVELLED / max(travel, 1e-9))
    high = 1.0 / max(SHORTEST, STEPS * quantum)
    inner = inner_ticks(whole, period)

    def passed(frequency: float) -> _Passed:
        at = inner & (speed * frequency > FASTER * MOTION)
        for turns in (frequency, 2.0 * frequency):
            # A wave that is sampled about once in each turn stands in the path.
            missed = np.abs(turns * speed * period - np.rint(turns * speed * period))
            at &= missed > FASTER * MOTION * period
        return _Passed(frequency, path[at], speed[at], (position - path)[at])

    moving = passed(high)
    if low >= high or len(moving.path) < FEWEST:
        return {}
    known = [passed(f) for (f,) in peaks(moving.path, moving.fast, low, high)]
    known = [p for p in known if len(p.path) >= FEWEST and p.fast.any()]
    best = min(known, key=lambda p: p.left(p.frequency), default=None)
    if best is None:
        return {}
    frequency = float(min(best.frequency + NEAR / travel, key=best.left))
    if best.left(frequency, force=True) < RATHER * best.left(frequency):
        return {}
    found = _fitted(best, frequency)
    return found if found['amplitude'][0] > LEAST_STEPS * quantum / math.pi else {}


def _fitted(passed: _Passed, frequency: float) -> Estimates:
    """Least squares over amplitudes, phases and the period, by Gauss-Newton steps."""
    matrix = np.column_stack(periodic.waves(passed.path, frequency))
    start, *_ = np.linalg.lstsq(matrix, passed.fast, rcond=None)
    values = periodic.found((frequency,), np.asarray(start, dtype=np.float64))
    scale = {n: 1.0 if n.startswith('phase') else v for n, v in values.items()}
    # A period shows by the phase at the ends of the travel.
    travel = float(np.ptp(passed.path))
    scale['period'] *= values['period'] / travel

    def moved(name: str, share: float) -> Array:
        return misreading(passed.path, {**values, name: values[name] + share * scale[name]})

    for _ in range(ROUNDS):
        left = passed.fast - misreading(passed.path, values)
        slopes = np.column_stack(
            [(moved(n, SMALL) - moved(n, -SMALL)) / (2.0 * SMALL) for n in values]
        )
        steps, *_ = np.linalg.lstsq(slopes, left, rcond=None)
        values = {
            n: v + float(s) * scale[n] for (n, v), s in zip(values.items(), steps, strict=True)
        }
    values = _positive(values)
    variance = np.diag(np.linalg.pinv(slopes.T @ slopes)) * float(np.var(left))
    return {
        n: (v, math.hypot(math.sqrt(s) * scale[n], doubt(n, values, travel, ANSWER)))
        for (n, v), s in zip(values.items(), variance, strict=True)
    }


def _positive(values: Mapping[str, float]) -> dict[str, float]:
    """The same wave with amplitudes above zero, and phases of half a turn at most."""
    out = dict(values)
    for name in [n for n in values if n.startswith('amplitude')]:
        phase = name.replace('amplitude', 'phase')
        turn = math.pi if values[name] < 0.0 else 0.0
        out[name] = abs(values[name])
        out[phase] = math.remainder(values[phase] + turn, 2.0 * math.pi)
    return out


def doubt(name: str, values: Mapping[str, float], travel: float, share: float) -> float:
    """Standard deviation of a wave's period, amplitude [m] or phase [rad].

    A `share` of the wave, in either phase, may be something else.
    """
    if name == 'period':
        return share / (2.0 * math.pi) * values['period'] ** 2 / travel
    moved = share * values['amplitude']
    kind, _, number = name.partition('_')
    if kind == 'amplitude':
        return moved
    size = values[f'amplitude_{number}' if number else 'amplitude']
    # A harmonic that is not there has any phase.
    return math.pi if size <= 0.0 else min(moved / size, math.pi)
