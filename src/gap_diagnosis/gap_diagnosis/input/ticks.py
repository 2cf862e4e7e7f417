"""Control ticks from stamps: which ticks of the machine the messages are, and when they were.

Every tick moves the machine on by one control period, but stamps tell it badly: they jitter, a
message is lost, a clock runs slow, and an emulated machine in real time stands still until a
late force has come (its stamps then jump, the machine does not move on). So ticks are counted,
and where the stamps jump the encoder decides whether the machine went on meanwhile.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from stage_core.arrays import Array

Ints = NDArray[np.int64]

JUMP = 1.5  # control periods between two stamps, from which on a tick may be missing
NEIGHBOURS = 5  # stamps on each side of a jump that may catch up with a late one
STEADY = 0.1  # control periods by which stamps that jitter may leave a straight line
BY_CHANCE = 8.0  # standard deviations of a mean; a median has 1.25 of them, a session 1e6 of it
EXACT = 1e-3  # the same of stamps that do not jitter
CLEAR = 5.0  # encoder steps by which two answers have to differ to be told apart
NEAR = 3  # ticks on each side of a jump that tell the speed
SMOOTHING = 101  # stamps of the running median where they jitter and jump


@dataclass(frozen=True)
class Clock:
    """Piecewise linear map from stamps to the machine's time, both [s], shape (m,)."""

    stamps: Array
    machine: Array

    def to_machine(self, stamps: Array) -> Array:
        """Machine's time of some stamps (n,) [s]."""
        return np.asarray(np.interp(stamps, self.stamps, self.machine))

    def to_stamps(self, machine: Array) -> Array:
        """First stamp of some machine times (n,) [s]."""
        last = np.concatenate([np.diff(self.machine) > 0.0, [True]])
        return np.asarray(np.interp(machine, self.machine[last], self.stamps[last]))


def tick_numbers(seconds: Array, period: float, position: Array, resolution: Array) -> Ints:
    """Number of the tick of each message (n,), counted from 0.

    Parameters
    ----------
    seconds : stamps (n,) [s]
    position : encoder (n, a) [m] of these messages
    resolution : encoder step of each axis (a,) [m]

    A jump of the stamps by m periods is m - 1 lost ticks if the encoder went m times as far as
    in the ticks around, and none if it went as far as in one. Where no axis moves fast enough to
    tell, the jumps that can be told decide for all.
    """
    gaps = np.diff(seconds) / period
    steps = np.ones(len(gaps), dtype=np.int64)
    jumps, passed = _jumps(gaps)
    if len(jumps) and not _complete(gaps):
        told, went = _told(position, resolution, jumps, passed)
        # Where the encoder does not tell, the machine did what it mostly did where it does.
        mostly = 2.0 * float(np.sum(went[told] - 1.0)) > float(np.sum(passed[told] - 1.0))
        others = passed if mostly or not told.any() else np.ones_like(passed)
        steps[jumps] = np.where(told, went, others).astype(np.int64)
    return np.concatenate([[0], np.cumsum(steps)])


def _complete(gaps: Array) -> bool:
    """Whether stamps that jitter, some of them widely, last as long as their ticks."""
    beyond = np.cumsum(gaps - 1.0)
    excess = np.median(beyond[-2 * NEIGHBOURS :]) - np.median(beyond[: 2 * NEIGHBOURS])
    return float(gaps.min()) < 0.999 and abs(float(excess)) < JUMP - 1.0


def _jumps(gaps: Array) -> tuple[Ints, Array]:
    """Indices k at which stamps jump between k and k + 1, and by how many periods.

    A late stamp is no jump: the stamps after it catch up.
    """
    candidates = np.flatnonzero(gaps > JUMP)
    excess = gaps[candidates] - 1.0
    if len(candidates) and gaps.min() < 0.999:
        beyond = np.concatenate([[0.0], np.cumsum(gaps - np.maximum(np.rint(gaps), 1.0))])
        own = gaps[candidates] - np.rint(gaps[candidates])
        # Of some stamps the median: two that jitter may be half a period apart by chance.
        around = [
            np.median(beyond[k + 1 : k + 2 + NEIGHBOURS])
            - np.median(beyond[max(k - NEIGHBOURS, 0) : k + 1])
            for k in candidates
        ]
        excess = excess + np.array(around) - own
    jumps = excess > JUMP - 1.0
    return candidates[jumps], np.rint(gaps[candidates[jumps]])


def _told(
    position: Array, resolution: Array, jumps: Ints, passed: Array
) -> tuple[NDArray[np.bool_], Array]:
    """Whether the encoder tells a jump, and how many periods the machine went on in it."""
    moves = np.diff(position, axis=0)
    own = moves[jumps]
    jumped = np.zeros(len(moves), dtype=bool)
    jumped[jumps] = True
    before, after = np.zeros_like(own), np.zeros_like(own)
    for row, k in enumerate(jumps.tolist()):
        before[row] = _speed(moves, jumped, np.arange(max(k - NEAR, 0), k))
        after[row] = _speed(moves, jumped, np.arange(k + 1, min(k + 1 + NEAR, len(moves))))
    # Where the speed changes in between, nothing is to be told.
    slower = np.where(before * after > 0.0, np.minimum(np.abs(before), np.abs(after)), 0.0)
    axis = np.argmax(slower / resolution, axis=1)
    rows = np.arange(len(jumps))
    told = (passed - 1.0) * slower[rows, axis] > CLEAR * resolution[axis]
    speed = 0.5 * (before + after)[rows, axis]
    went = np.rint(own[rows, axis] / np.where(told, speed, 1.0))
    return told, np.clip(went, 1.0, passed)


def _speed(moves: Array, jumped: NDArray[np.bool_], near: Ints) -> Array:
    """Median move per tick (a,) [m] of some ticks, of those without a jump where there are any."""
    calm = near[~jumped[near]]
    near = calm if len(calm) else near
    if not len(near):
        return np.zeros(moves.shape[1])
    return np.asarray(np.median(moves[near], axis=0))


def machine_clock(seconds: Array, numbers: Ints, period: float) -> tuple[Array, Clock | None]:
    """Times of the ticks (n,) [s] on the machine's clock, and the map that leads to it.

    Stamps on a straight line over the ticks, jittering or not, need no map: the line is the
    machine's time (a slow clock drops out), None its map. Else the machine's time goes on by a
    period per tick, and stands still in what is left of a jump.
    """
    line = np.polyfit(numbers, seconds, 1)
    time = np.asarray(np.polyval(line, numbers), dtype=np.float64)
    offset = seconds - time
    jitters = float(np.min(np.diff(seconds) / np.diff(numbers))) < 0.999 * period
    size = min(SMOOTHING, len(offset)) if jitters else 1
    steady = median_filter(offset, size, mode='reflect')
    # What the median of so many stamps that jitter strays by chance.
    chance = BY_CHANCE * float(np.std(offset - steady)) / np.sqrt(size)
    if np.max(np.abs(steady)) < max((STEADY if jitters else EXACT) * period, chance):
        return time, None
    offset = median_filter(seconds - numbers * period, size, mode='nearest')
    stamps = numbers * period + offset
    time = np.asarray(stamps[0] + (numbers - numbers[0]) * period, dtype=np.float64)
    # The machine stands still first and goes on then: the tick ends with its stamp.
    wait = np.maximum(stamps[1:] - np.diff(time), stamps[:-1])
    knots = np.empty(2 * len(stamps) - 1)
    knots[0::2], knots[1::2] = stamps, wait
    machine = np.empty_like(knots)
    machine[0::2], machine[1::2] = time, time[:-1]
    return time, Clock(knots, machine)
