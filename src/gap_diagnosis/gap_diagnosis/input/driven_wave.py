"""A wave that an encoder reads over its own position, told by the force that follows it.

The loop follows what the encoder reads, so that the drive moves the mass against the wave. Its
force is that of the motion behind the reading: it lacks the acceleration that only the reading
has. A force of the position would be there at any speed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.input.reading_wave import LEAST_STEPS, doubt, reading_wave
from gap_diagnosis.parameters import Estimates
from gap_diagnosis.residuals.low_pass import band_limited
from gap_diagnosis.residuals.operators import central_difference
from stage_core.arrays import Array
from stage_twin.effects import periodic
from stage_twin.effects.encoder_interpolation import (
    LONGEST,
    SHORTEST,
    STEPS,
    TRAVELLED,
    peaks,
)

Mask = NDArray[np.bool_]

#: Hz, between which forces and motions are compared, and a wave is passed.
BAND, PASSED = (2.0, 60.0), (4.0, 30.0)
HARMONICS, SMOOTH = 2, 5.0  # Hz, up to which a speed is that without the wave
#: Mean square that a force's wave leaves, over that which a read wave leaves: 4 to 69 on 11 axes
#: of two generators and a foreign simulator whose encoders err, and 1.01 at most on 73 others of
#: that simulator. On two that pass their waves faster it was 1.4 and 1.6, and the amplitudes were
#: 61 and 87 % short.
RATHER = 2.5
#: Share by which amplitudes miss what they are: on those 11 axes by -3 to +14 %.
DOUBT = 0.15
FEWEST = 500  # ticks
EDGE = 0.2  # s at the ends, where the low-pass has no path
CREEPS = 0.02  # of the top speed, at which nothing is told
NEAR = np.linspace(-0.5, 0.5, 11)  # turns over the travel about a peak


@dataclass(frozen=True)
class _Driven:
    """The motion of an axis on the ticks of a period [s], and what it lacks of its force.

    `path` (n,) [m] is the motion without what is fast, `speed` (n,) [m/s] is without what a wave
    adds to it, `left` (n,) the acceleration [m/s²] that the force gives and the reading lacks.
    """

    path: Array
    speed: Array
    left: Array
    period: float

    @classmethod
    def of(cls, position: Array, force: Array, period: float) -> _Driven:
        """The same of readings and of the force over the mass [m/s²]."""
        path = band_limited(position, period, BAND[1])
        velocity = central_difference(path, period)
        speed = band_limited(velocity, period, SMOOTH)
        own = cls(path, np.abs(speed), velocity, period)
        columns = np.column_stack([velocity, np.sign(speed), force])
        viscous, dry, driven = own.in_band(columns).T
        frictions = np.column_stack([viscous, dry])
        left = driven - own.in_band(own.accelerations(path[:, None]))[:, 0]
        shares, *_ = np.linalg.lstsq(frictions, left, rcond=None)
        return replace(own, left=left - frictions @ shares)

    def in_band(self, columns: Array) -> Array:
        """Columns (n, k) within `BAND`."""
        passed = band_limited(columns, self.period, BAND[1])
        return np.asarray(passed - band_limited(passed, self.period, BAND[0]))

    def accelerations(self, columns: Array) -> Array:
        """Second derivatives in time of columns (n, k)."""
        once = np.gradient(columns, self.period, axis=0)
        return np.asarray(np.gradient(once, self.period, axis=0))

    def wave(self, frequency: float, at: Mask, pushes: bool) -> tuple[float, Array]:
        """What a wave leaves of the mean square at some ticks, and its coefficients (k,).

        It is of a spatial frequency [1/m], and one of a force or of the reading.
        """
        waves = np.column_stack(periodic.waves(self.path, frequency, HARMONICS))
        matrix = self.in_band(waves if pushes else -self.accelerations(waves))[at]
        found, *_ = np.linalg.lstsq(matrix, self.left[at], rcond=None)
        left = float(np.mean((self.left[at] - matrix @ found) ** 2))
        return left, np.asarray(found, dtype=np.float64)

    def frequencies(self, inner: Mask, quantum: float) -> Array:
        """Spatial frequencies (k,) [1/m] of waves that may be there."""
        moves = inner & (self.speed > CREEPS * self.speed.max(initial=0.0))
        travel = float(np.ptp(self.path))
        if np.count_nonzero(moves) < FEWEST or travel <= 0.0:
            return np.zeros(0)
        low = max(1.0 / LONGEST, TRAVELLED / travel)
        slow = float(np.percentile(self.speed[moves], 10.0))
        high = min(1.0 / max(SHORTEST, STEPS * quantum), PASSED[1] / slow)
        if low >= high:
            return np.zeros(0)
        tops = peaks(self.path[moves], (self.left * self.speed**2)[moves], low, high)
        return np.concatenate([top + NEAR / travel for (top,) in tops])

    def passing(self, frequency: float) -> Mask:
        """Ticks (n,) at which a wave of a spatial frequency is passed within `PASSED`."""
        turns = self.speed * frequency
        return (turns > PASSED[0]) & (turns < PASSED[1])


def own_wave(
    position: Array, driven: Array | None, period: float, whole: Mask, quantum: float
) -> Estimates:
    """What readings tell of a wave that is passed fast, or else the force: see `driven_wave`."""
    found = reading_wave(position, period, whole, quantum)
    if found or driven is None:
        return found
    return driven_wave(position, driven, period, whole, quantum)


def driven_wave(
    position: Array, driven: Array, period: float, whole: Mask, quantum: float
) -> Estimates:
    """Parameters of `encoder_interpolation` with standard deviations; empty where none shows.

    Parameters
    ----------
    position, driven : (n,) of an encoder [m], and force of its drive over the mass that it moves
        [m/s²], on the ticks of a period [s]
    whole : (n,) ticks that are far from lost ones
    quantum : step of the encoder [m]
    """
    inner = whole.copy()
    edge = round(EDGE / period)
    inner[:edge] = inner[-edge:] = False
    own = _Driven.of(position, driven, period)
    best: tuple[float, float, Array] | None = None
    for frequency in own.frequencies(inner, quantum).tolist():
        at = inner & own.passing(frequency)
        if np.count_nonzero(at) < FEWEST:
            continue
        read, found = own.wave(frequency, at, pushes=False)
        pushed, _ = own.wave(frequency, at, pushes=True)
        if pushed > RATHER * read and (best is None or read < best[0]):
            best = read, frequency, found
    if best is None:
        return {}
    values = periodic.found((best[1],), best[2])
    if values['amplitude'] < LEAST_STEPS * quantum / math.pi:
        return {}
    travel = float(np.ptp(own.path))
    return {n: (v, doubt(n, values, travel, DOUBT)) for n, v in values.items()}
