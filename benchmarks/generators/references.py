"""Set-point paths: smooth, at rest at the start, of the kinds that stages are asked for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from .machine import Machine

Path = np.ndarray
SHORTEST_MOVE = 0.08


@dataclass(frozen=True)
class Reference:
    """Positions and velocities (ticks, 2) [m, m/s] at times k·Ts, and the kinds they came from."""

    position: np.ndarray
    velocity: np.ndarray
    kinds: tuple[str, ...]


@dataclass(frozen=True)
class Pen:
    """What a part of a path is drawn with: the bounds of its motion, here already chosen."""

    rng: np.random.Generator
    period: float
    centre: np.ndarray
    span: np.ndarray
    speed: np.ndarray
    acceleration: np.ndarray

    def move(self, start: np.ndarray, end: np.ndarray, slow: float = 1.0) -> Path:
        """Quintic move (at rest at both ends) as fast as the bounds allow, or slower."""
        distance = np.abs(end - start)
        fastest = np.maximum(
            1.875 * distance / self.speed, np.sqrt(5.774 * distance / self.acceleration)
        )
        seconds = slow * max(SHORTEST_MOVE, float(fastest.max()))
        s = np.linspace(0.0, 1.0, max(2, round(seconds / self.period)) + 1)[1:]
        return start + (end - start) * (s**3 * (10.0 - 15.0 * s + 6.0 * s**2))[:, None]

    def wait(self, at: np.ndarray, seconds: float) -> Path:
        """Rest."""
        return np.tile(at, (max(1, round(seconds / self.period)), 1))

    def place(self) -> np.ndarray:
        """Some point of the field."""
        return self.centre + self.span * self.rng.uniform(-0.5, 0.5, 2)

    def corner(self, sx: float, sy: float) -> np.ndarray:
        """A corner of the field, by signs."""
        return self.centre + 0.5 * self.span * np.array([sx, sy])

    def clock(self, seconds: float) -> np.ndarray:
        """Times of a part's ticks, the first one period after its start."""
        return self.period * np.arange(1, max(2, round(seconds / self.period)) + 1)


def draw_reference(rng: np.random.Generator, machine: Machine, seconds: float) -> Reference:
    """A session of one to three kinds of motion, filled up with more of the last.

    About one session in three is poorly exciting: small, slow, one-way or of one axis only.
    """
    poor = rng.random() < 0.35
    names = list(POOR if poor else GOOD)
    kinds = [names[i] for i in rng.permutation(len(names))[: 1 if poor else rng.integers(1, 4)]]
    pen = _pen(rng, machine, poor)
    ticks = round(seconds / machine.control_period)
    corner = kinds[0] == 'one_way' or rng.random() < 0.5
    at = pen.corner(-1.0, -1.0) if corner else pen.centre.copy()
    parts = [at[None, :], pen.wait(at, rng.uniform(0.1, 0.6))]
    total = len(parts[1]) + 1
    for turn in range(200):
        kind = kinds[min(turn, len(kinds) - 1)]
        part = (POOR if poor else GOOD)[kind](pen, at, seconds / len(kinds))
        parts.append(part)
        at, total = part[-1], total + len(part)
        if total > ticks:
            break
    position = np.concatenate(parts)[:ticks]
    return _timed(position, machine.control_period, tuple(kinds))


def _pen(rng: np.random.Generator, machine: Machine, poor: bool) -> Pen:
    travel = np.array(machine.travel)
    span = travel * rng.uniform(0.25, 0.9, 2)
    if poor and rng.random() < 0.5:
        span[rng.integers(2)] *= 1e-9
    return Pen(
        rng,
        machine.control_period,
        travel * rng.uniform(-0.05, 0.6, 2),
        span,
        np.array(machine.speed) * rng.uniform(0.3, 1.0),
        np.array(machine.acceleration) * rng.uniform(0.3, 0.9),
    )


def _timed(position: np.ndarray, period: float, kinds: tuple[str, ...]) -> Reference:
    """The path with its velocity, from a spline through its ticks (at rest at the start)."""
    position = np.round(position, 12)
    times = period * np.arange(len(position))
    ends = ((1, np.zeros(2)), (2, np.zeros(2)))
    velocity = CubicSpline(times, position, bc_type=ends)(times, 1)
    return Reference(position, np.round(velocity, 12), kinds)


def _points(pen: Pen, at: np.ndarray, _: float) -> Path:
    parts = []
    for _turn in range(8):
        end = pen.place()
        parts += [pen.move(at, end, pen.rng.uniform(1.0, 1.8))]
        parts += [pen.wait(end, pen.rng.uniform(0.02, 0.4))]
        at = end
    return np.concatenate(parts)


def _raster(pen: Pen, at: np.ndarray, _: float) -> Path:
    lines = int(pen.rng.integers(4, 9))
    along = int(pen.rng.integers(2))
    slow = pen.rng.uniform(1.0, 1.6)
    parts = []
    for line in range(lines):
        across = -1.0 + 2.0 * line / (lines - 1)
        for side in (-1.0, 1.0) if line % 2 == 0 else (1.0, -1.0):
            signs = (side, across) if along == 0 else (across, side)
            end = pen.corner(*signs)
            parts.append(pen.move(at, end, slow))
            at = end
    return np.concatenate(parts)


def _circle(pen: Pen, at: np.ndarray, seconds: float) -> Path:
    """Ellipse or Lissajous figure whose phase starts and ends at rest."""
    radius = 0.5 * pen.span
    times = np.array([1.0, float(pen.rng.choice([1.0, 1.0, 2.0, 1.5]))])
    rate = np.min(np.minimum(pen.speed / radius, np.sqrt(pen.acceleration / radius)) / times)
    rate *= pen.rng.uniform(0.4, 0.95)
    length = min(seconds, pen.rng.uniform(8.0, 25.0))
    t = pen.clock(length)
    ramp = min(1.0, length / 4.0)
    phase = rate * (_ramped(t, ramp) - _ramped(t - (length - ramp), ramp))
    angles = phase[:, None] * times
    shape = np.column_stack([np.cos(angles[:, 0]), np.sin(angles[:, 1])])
    start = pen.centre + radius * np.array([1.0, 0.0])
    return np.concatenate([pen.move(at, start), pen.centre + radius * shape])


def _ramped(t: np.ndarray, ramp: float) -> np.ndarray:
    """Integral of a rate that rises smoothly from 0 to 1 within `ramp`."""
    s = np.clip(t / ramp, 0.0, 1.0)
    return ramp * (2.5 * s**4 - 3.0 * s**5 + s**6) + np.maximum(t - ramp, 0.0)


def _chirp(pen: Pen, at: np.ndarray, seconds: float) -> Path:
    length = min(seconds, pen.rng.uniform(10.0, 25.0))
    t = pen.clock(length)
    low, high = pen.rng.uniform(0.1, 0.4), pen.rng.uniform(4.0, 20.0)
    parts = []
    for axis in range(2):
        lower = low * (1.0 if axis == 0 else 1.31)
        omega = 2.0 * np.pi * lower * (high / lower) ** (t / length)
        phase = np.cumsum(omega) * pen.period
        bound = [0.5 * pen.span[axis], pen.speed[axis] / omega]
        bound += [pen.acceleration[axis] / omega**2]
        size = sum(np.power(b, -4.0) for b in bound) ** -0.25
        envelope = np.clip(np.minimum(t, length - t) / 1.0, 0.0, 1.0)
        envelope = envelope**3 * (10.0 - 15.0 * envelope + 6.0 * envelope**2)
        parts.append(pen.centre[axis] + size * envelope * np.sin(phase))
    return np.concatenate([pen.move(at, pen.centre), np.column_stack(parts)])


def _creep(pen: Pen, at: np.ndarray, seconds: float) -> Path:
    """There and back over a few millimetres, far below the stage's speed."""
    reach = np.minimum(pen.span, pen.rng.uniform(0.002, 0.01))
    parts = []
    for _turn in range(6):
        end = at + reach * pen.rng.choice([-1.0, 1.0], 2)
        end = np.clip(end, pen.corner(-1.0, -1.0), pen.corner(1.0, 1.0))
        quick = len(pen.move(at, end)) * pen.period
        parts.append(pen.move(at, end, max(1.0, pen.rng.uniform(1.5, 5.0) / quick)))
        parts.append(pen.wait(end, pen.rng.uniform(0.05, 0.3)))
        at = end
    return np.concatenate(parts)


def _one_way(pen: Pen, at: np.ndarray, seconds: float) -> Path:
    """One crossing of the field in steps, never back, on a bent path.

    On a straight one no error of x as a function of y could be told from one of x.
    """
    start, end = pen.corner(-1.0, -1.0), pen.corner(1.0, 1.0)
    if float(np.max(np.abs(at - start))) > 1e-9:
        return pen.wait(at, seconds)
    steps = int(pen.rng.choice([4, 6, 10, 25]))
    parts = []
    for step in range(steps):
        share = (step + 1) / steps
        goal = start + (end - start) * np.array([share, share**2])
        quick = len(pen.move(at, goal)) * pen.period
        slow = max(1.0, pen.rng.uniform(0.5, 0.9) * seconds / steps / quick)
        parts += [pen.move(at, goal, slow), pen.wait(goal, pen.rng.uniform(0.05, 0.3))]
        at = goal
    return np.concatenate(parts)


Kind = Callable[[Pen, np.ndarray, float], Path]
GOOD: dict[str, Kind] = {
    'points': _points,
    'raster': _raster,
    'circle': _circle,
    'chirp': _chirp,
    'creep': _creep,
}
POOR: dict[str, Kind] = {'points': _points, 'creep': _creep, 'one_way': _one_way}
