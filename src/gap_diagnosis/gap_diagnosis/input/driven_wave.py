"""A wave that an encoder reads over its own position, told by the force that follows it.

The loop follows what the encoder reads, so that the drive moves the mass against the wave. Its
force is that of the motion behind the reading: it lacks the acceleration that only the reading
has. A force of the position would be there at any speed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from gap_diagnosis.input.reading_wave import (
    FEWEST,
    LEAST_STEPS,
    NEAR,
    Mask,
    doubt,
    inner_ticks,
)
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

#: Hz, between which forces and motions are compared, and a wave is passed.
BAND, PASSED = (2.0, 60.0), (4.0, 30.0)
HARMONICS, SMOOTH = 2, 5.0  # Hz, up to which a speed is that without the wave
#: Mean square that a force's wave leaves, over that which a read wave leaves: 3.7 to 69 on 12 axes
#: of two generators and two foreign simulators whose encoders err, and 1.4 at most on 220 others
#: of those simulators. On some that pass their waves faster it was up to 1.6, and the amplitudes
#: were 60 to 99 % short.
RATHER = 2.5
#: Share by which amplitudes miss what they are: on those 12 axes by -6 to +13 %.
DOUBT = 0.15
CREEPS = 0.02  # of the top speed, at which nothing is told


@dataclass(frozen=True)
class _Driven:
    """The motion of an axis on the ticks of a period [s], and what it lacks of its force.

    `path`, `velocity` and `acceleration` (n,) [m, m/s, m/s²] are the motion without what is fast,
    `speed` (n,) [m/s] is without what a wave adds to it, `left` (n,) the acceleration [m/s²] that
    the force gives and the reading lacks.
    """

    path: Array
    velocity: Array
    acceleration: Array
    speed: Array
    left: Array
    period: float

    @classmethod
    def of(cls, position: Array, force: Array, period: float) -> _Driven:
        """The same of readings and of the force over the mass [m/s²]."""
        path = band_limited(position, period, BAND[1])
        velocity = central_difference(path, period)
        acceleration = central_difference(velocity, period)
        speed = band_limited(velocity, period, SMOOTH)
        columns = np.column_stack([velocity, np.sign(speed), force, acceleration])
        viscous, dry, driven, moved = _in_band(columns, period).T
        frictions, left = np.column_stack([viscous, dry]), driven - moved
        shares, *_ = np.linalg.lstsq(frictions, left, rcond=None)
        left -= frictions @ shares
        return cls(path, velocity, acceleration, np.abs(speed), left, period)

    def columns(self, frequency: float, pushes: bool, at: Mask | slice = slice(None)) -> Array:
        """Accelerations (m, k) at some ticks that waves of a spatial frequency [1/m] give.

        They are those of a force, or those that a reading of the waves lacks.
        """
        waves = periodic.waves(self.path[at], frequency, HARMONICS)
        if pushes:
            return np.column_stack(waves)
        return -np.column_stack(
            [
                w
                for k, (sine, cosine) in enumerate(zip(waves[::2], waves[1::2], strict=True), 1)
                for w in self._curved(sine, cosine, 2.0 * math.pi * k * frequency, at)
            ]
        )

    def _curved(self, sine: Array, cosine: Array, turn: float, at: Mask | slice) -> list[Array]:
        """Second derivatives in time of a sine and a cosine (m,) that turn so [rad/m]."""
        swift, bent = (turn * self.velocity[at]) ** 2, turn * self.acceleration[at]
        return [bent * cosine - swift * sine, -bent * sine - swift * cosine]

    def wave(self, frequency: float, at: Mask, pushes: bool) -> tuple[float, Array]:
        """What waves leave of the mean square at some ticks, and their coefficients (k,)."""
        return _left(_in_band(self.columns(frequency, pushes), self.period)[at], self.left[at])

    def peaks(self, inner: Mask, quantum: float) -> list[float]:
        """Spatial frequencies [1/m] about which waves may be."""
        moves = inner & (self.speed > CREEPS * self.speed.max(initial=0.0))
        travel = float(np.ptp(self.path))
        if np.count_nonzero(moves) < FEWEST or travel <= 0.0:
            return []
        low = max(1.0 / LONGEST, TRAVELLED / travel)
        slow = float(np.percentile(self.speed[moves], 10.0))
        high = min(1.0 / max(SHORTEST, STEPS * quantum), PASSED[1] / slow)
        if low >= high:
            return []
        tops = peaks(self.path[moves], (self.left * self.speed**2)[moves], low, high)
        return [top for (top,) in tops]

    def nearest(self, top: float, at: Mask) -> float:
        """The spatial frequency about a peak whose read wave leaves least at some ticks.

        The waves are not passed through the band: at these ticks they lie within it.
        """
        near = (top + NEAR / float(np.ptp(self.path))).tolist()
        left = [_left(self.columns(f, pushes=False, at=at), self.left[at])[0] for f in near]
        return float(near[int(np.argmin(left))])

    def passing(self, frequency: float) -> Mask:
        """Ticks (n,) at which a wave of a spatial frequency is passed within `PASSED`."""
        turns = self.speed * frequency
        return (turns > PASSED[0]) & (turns < PASSED[1])


def _in_band(columns: Array, period: float) -> Array:
    """Columns (n, k) within `BAND`."""
    passed = band_limited(columns, period, BAND[1])
    return np.asarray(passed - band_limited(passed, period, BAND[0]))


def _left(matrix: Array, values: Array) -> tuple[float, Array]:
    """What columns (m, k) leave of the mean square of values (m,), and their shares (k,)."""
    found, *_ = np.linalg.lstsq(matrix.T @ matrix, matrix.T @ values, rcond=None)
    return float(np.mean((values - matrix @ found) ** 2)), np.asarray(found, dtype=np.float64)


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
    inner = inner_ticks(whole, period)
    own = _Driven.of(position, driven, period)
    best: tuple[float, float, Array] | None = None
    for top in own.peaks(inner, quantum):
        at = inner & own.passing(top)
        if np.count_nonzero(at) < FEWEST:
            continue
        frequency = own.nearest(top, at)
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
