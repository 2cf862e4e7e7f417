"""The motions among which an experiment is chosen: strokes, sweep, multisine and raster.

Every motion is a few numbers (`Motion`), starts and ends at rest at its centre, and keeps the
limits of each axis by its own construction or by taking longer.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from stage_core.arrays import Array

KINDS = ('strokes', 'sweep', 'multisine', 'raster')
#: Which axes move: one alone, both alike, both at their own pace.
PACES: tuple[tuple[float, float], ...] = ((1.0, 0.0), (0.0, 1.0), (1.0, 1.0), (1.0, 0.7))
FADE = 0.4  # s, of oscillations at both ends
PAUSE = 0.15  # s, between strokes, so that stiction shows
LINES = 8  # of a multisine
#: The smallest amplitude [m] and speed [m/s] that are asked of a stage.
SMALLEST, SLOWEST = 50e-6, 1e-3


@dataclass(frozen=True)
class Limits:
    """What the stage may do: travel per axis (a,) [m], speed, acceleration and jerk of each axis.

    Those of the motion are a tenth below what `contour_ctrl` accepts by default. `force` (a,) [N]
    bounds what any candidate predicts; `duration` [s] the whole experiment.
    """

    low: Array
    high: Array
    force: Array
    speed: float = 0.18
    acceleration: float = 1.8
    jerk: float = 100.0
    duration: float = 60.0


@dataclass(frozen=True)
class Motion:
    """A motion of the family; all but the kind lie between 0 and 1.

    Attributes
    ----------
    kind : one of `KINDS`
    size : amplitude, from the smallest to half the travel on a logarithmic scale
    speed : from the slowest to the limit, logarithmic: of strokes; of oscillations at most
    place : of the centre in what the amplitude leaves of the travel, per axis
    pace : which axes move, an index of `PACES`
    phase : of the lines of a multisine
    """

    kind: str
    size: float
    speed: float
    place: tuple[float, float]
    pace: int
    phase: int = 0

    def near(self, generator: np.random.Generator, reach: float) -> Motion:
        """A motion of the same kind whose numbers are up to `reach` away."""
        moved = np.clip(
            np.array([self.size, self.speed, *self.place]) + generator.uniform(-reach, reach, 4),
            0.0,
            1.0,
        ).tolist()
        return replace(self, size=moved[0], speed=moved[1], place=(moved[2], moved[3]))


def draw(kind: str, generator: np.random.Generator, axes: int) -> Motion:
    """A motion of a kind at random."""
    size, speed, x, y = generator.uniform(0.0, 1.0, 4).tolist()
    pace = int(generator.integers(len(PACES))) if axes == 2 else 0
    return Motion(kind, size, speed, (x, y), pace, int(generator.integers(1000)))


def boldest(kind: str, axes: int) -> Motion:
    """All of the travel, as fast as may be, each axis at its own pace."""
    return Motion(kind, 1.0, 1.0, (0.5, 0.5), len(PACES) - 1 if axes == 2 else 0)


def amplitude(motion: Motion, limits: Limits) -> Array:
    """Amplitude (a,) [m] of each axis before its pace."""
    largest = 0.5 * (limits.high - limits.low)
    smallest = np.minimum(SMALLEST, largest)
    return np.asarray(smallest * (largest / smallest) ** motion.size)


def feed(motion: Motion, limits: Limits) -> float:
    """Highest speed of an axis [m/s]."""
    return float(SLOWEST * (limits.speed / SLOWEST) ** motion.speed)


def sample(motion: Motion, limits: Limits, duration: float, period: float) -> Array:
    """Reference (n, a) [m] of a motion of `duration` [s], from rest to rest at its centre."""
    reach = amplitude(motion, limits)
    room = 0.5 * (limits.high - limits.low) - reach
    place = 2.0 * np.array(motion.place[: len(reach)]) - 1.0
    centre: Array = 0.5 * (limits.low + limits.high) + place * room
    t = np.asarray(np.arange(round(duration / period)) * period)
    pace = np.asarray(PACES[motion.pace][: len(reach)], dtype=float)
    if len(reach) == 1:
        pace = np.ones(1)
    make: dict[str, Callable[[Motion, Limits, Array, Array, Array], Array]]
    make = {'strokes': _strokes, 'raster': _raster, 'sweep': _sweep, 'multisine': _multisine}
    return np.asarray(centre + make[motion.kind](motion, limits, t, reach, pace))


def _ramp(speed: float, limits: Limits) -> float:
    """Time [s] from rest to a speed with a smooth step of the speed."""
    return max(1.5 * speed / limits.acceleration, math.sqrt(6.0 * speed / limits.jerk))


def _stroke(length: float, speed: float, limits: Limits) -> tuple[float, float, float]:
    """Speed that a stroke reaches, its ramp and its whole duration."""
    while speed * _ramp(speed, limits) > length:
        speed *= 0.8
    ramp = _ramp(speed, limits)
    return speed, ramp, length / speed + ramp


def _path(t: Array, start: float, stop: float, at: float, stroke: tuple[float, ...]) -> Array:
    """What a stroke that begins at `at` adds to the position (n,)."""
    speed, ramp, lasting = stroke
    u = np.clip(t - at, 0.0, lasting)

    def risen(s: Array) -> Array:
        """Integral of a smooth step of one ramp."""
        w = np.clip(s / ramp, 0.0, 1.0)
        return np.asarray(ramp * (w**3 - 0.5 * w**4) + np.maximum(s - ramp, 0.0))

    way = speed * (risen(u) - risen(np.maximum(u - (lasting - ramp), 0.0)))
    return np.sign(stop - start) * way


def _strokes(motion: Motion, limits: Limits, t: Array, reach: Array, pace: Array) -> Array:
    """Trapezoids to and fro, in turn at the speed, its half and its double (if it may)."""
    out = np.zeros((len(t), len(reach)))
    for i, (size, own) in enumerate(zip(reach, pace, strict=True)):
        if own == 0.0:
            continue
        at, position, turn = 0.2, 0.0, 0
        back = (0.0, 0.0, 0.0)
        while True:
            factor = (1.0, 0.5, 2.0)[turn // 2 % 3]
            speed = min(own * factor * feed(motion, limits), limits.speed)
            goal = size if turn % 2 == 0 else -size
            stroke = _stroke(abs(goal - position), speed, limits)
            home = _stroke(size, speed, limits)
            if at + stroke[2] + home[2] + 2.0 * PAUSE > t[-1]:
                break
            out[:, i] += _path(t, position, goal, at, stroke)
            at, position, turn, back = at + stroke[2] + PAUSE, goal, turn + 1, home
        if position != 0.0:
            out[:, i] += _path(t, position, 0.0, at, back)
    return out


def _raster(motion: Motion, limits: Limits, t: Array, reach: Array, pace: Array) -> Array:
    """The first axis of the pace strokes, the other one steps on at every turn and comes back."""
    out = _strokes(motion, limits, t, reach, np.where(pace == pace.max(), 1.0, 0.0) * pace.max())
    if len(reach) == 1:
        return out
    fast = int(np.argmax(np.ptp(out, axis=0)))
    out[:, 1 - fast] = 0.0
    slow, lines = float(reach[1 - fast]), 6
    corners = [*np.linspace(0.0, slow, lines // 2), *np.linspace(slow, -slow, lines)[1:], 0.0]
    length = t[-1] / len(corners)
    for k, (start, stop) in enumerate(zip(corners[:-1], corners[1:], strict=True)):
        way = abs(stop - start)
        stroke = _stroke(way, min(limits.speed, 2.5 * way / length), limits)
        if stroke[2] > 0.95 * length:
            # Too far for the time: the fast axis alone.
            out[:, 1 - fast] = 0.0
            break
        out[:, 1 - fast] += _path(t, float(start), float(stop), length * (k + 0.4), stroke)
    return out


def _faded(t: Array, wave: Array) -> Array:
    edge = np.clip(np.minimum(t, t[-1] - t) / FADE, 0.0, 1.0)
    return np.asarray(wave * (edge**3 * (10.0 - 15.0 * edge + 6.0 * edge**2))[:, None])


def _bounded(size: Array, speed: float, omega: Array, limits: Limits) -> Array:
    """Amplitude (k, a) [m] of lines omega (k,) [rad/s] within half of every limit."""
    w = omega[:, None]
    bound = np.minimum(speed / w, np.minimum(limits.acceleration / w**2, limits.jerk / w**3))
    return np.asarray(0.5 * np.minimum(size, bound))


def _sweep(motion: Motion, limits: Limits, t: Array, reach: Array, pace: Array) -> Array:
    """One line whose frequency rises from 0.3 to 12 Hz, as large as the limits let it."""
    speed, share = feed(motion, limits), t / t[-1]
    low, high = 0.3, 12.0
    rate = 2.0 * np.pi * low * (high / low) ** share
    angle = np.cumsum(rate) * (t[1] - t[0])
    size = _bounded(reach, speed, rate, limits)
    return _faded(t, size * np.sin(angle[:, None] * np.where(pace == 0.0, 1.0, pace)) * (pace > 0))


def _multisine(motion: Motion, limits: Limits, t: Array, reach: Array, pace: Array) -> Array:
    """Lines from 0.3 to 15 Hz with random phases, each with its share of the limits."""
    generator = np.random.default_rng(motion.phase)
    omega = 2.0 * np.pi * np.geomspace(0.3, 15.0, LINES)
    size = _bounded(reach, feed(motion, limits), omega, limits) * 2.0 / LINES
    phase = generator.uniform(0.0, 2.0 * np.pi, (LINES, len(reach)))
    if pace.min() == pace.max():
        phase[:] = phase[:, :1]
    waves = np.sin(omega * t[:, None])[:, :, None] * np.cos(phase) + np.cos(omega * t[:, None])[
        :, :, None
    ] * np.sin(phase)
    return _faded(t, np.sum(size * waves, axis=1) * (pace > 0))


def excess(position: Array, limits: Limits, period: float) -> float:
    """Largest ratio of a motion's travel, speed or acceleration to its limit."""
    rate = np.gradient(position, period, axis=0)
    middle, half = 0.5 * (limits.low + limits.high), 0.5 * (limits.high - limits.low)
    return max(
        float(np.max(np.abs(position - middle) / half)),
        float(np.abs(rate).max()) / limits.speed,
        float(np.abs(np.gradient(rate, period, axis=0)).max()) / limits.acceleration,
    )


def joined(pieces: list[Array], limits: Limits, period: float) -> Array:
    """Pieces (n, a) one after the other, with smooth straight ways between them."""
    out = [pieces[0]]
    for piece in pieces[1:]:
        out.append(way(out[-1][-1], piece[0], limits, period))
        out.append(piece)
    return np.concatenate(out)


def way(start: Array, stop: Array, limits: Limits, period: float) -> Array:
    """Straight way (n, a) from rest to rest at a fifth of the speed limit, quintic in time."""
    length = float(np.abs(stop - start).max())
    # A quintic peaks at 1.875 times its mean speed and 5.8 length / duration^2.
    lasting = max(
        0.2, 1.875 * length / (0.2 * limits.speed), math.sqrt(5.8 * length / limits.acceleration)
    )
    s = np.linspace(0.0, 1.0, max(3, math.ceil(lasting / period)))[:, None]
    return np.asarray(start + (stop - start) * s**3 * (10.0 - 15.0 * s + 6.0 * s**2))
