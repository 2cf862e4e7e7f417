"""Periods of a position that a residual shows, and the harmonics over one of them."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from stage_core.arrays import Array
from stage_twin.effects.term import Term, Theta
from stage_twin.effects.waveform import HARMONICS, WAVES, grown

Rows = slice | NDArray[np.bool_]
ALL = slice(None)

PERIODS = 200  # shortest period as a share of the travel
#: The same as a share of the screw's lead or the motor's turn, where that is less: the cogging of
#: two recorded motors has orders up to 84 and 72.
ORDERS = 100
PHASE_STEP = 0.01  # of a spatial frequency, in periods over the travel
GROWTH_STEP = 0.01  # of an amplitude
BINS = 16  # of a periodogram over the position, in the shortest period
PAD = 4  # frequencies of a periodogram in one turn over the travel
PEAKS = 4
ALONE = 0.05  # of a higher harmonic, below which the others are none and it is the period
LEAST_TURNS = 3.0  # of a wave over the travel: a slower one is any smooth curve
FEW_TURNS = 2.0  # of a wave that is the same in both halves of the travel
#: Largest difference of the halves' amplitudes as a share of the whole's. Of 800 random curves of
#: ten orders one in thirty has less, the cyclic error of `ess_tank` (2.4 turns) has 0.07.
SAME = 0.2
OWN_TURN = 0.25  # turns over the travel, within which a period is the screw's own


def with_harmonics(
    plain: Term,
    columns: Callable[[int, Theta], Array],
    richest: Term | None = None,
    harmonics: int = 1,
) -> Term:
    """A term of as many harmonics, richer by one each; `columns` takes their number and θ.

    The `richest` one, which has all of them, stands for the last.
    """
    if harmonics == HARMONICS and richest is not None:
        return richest
    following = partial(with_harmonics, plain, columns, richest, harmonics + 1)
    return replace(
        plain,
        columns=lambda theta: columns(harmonics, theta),
        nuisances=tuple(range(2 * harmonics)),
        phase=True,
        richer=following if harmonics < HARMONICS else None,
    )


def along_the_travel(
    plain: Term,
    make: Callable[[Callable[[Array], list[Array]]], Array],
    path: Array,
    lead: float,
    rows: Rows = ALL,
) -> Term:
    """A term of θ = (frequency,) with all harmonics, whose richer shapes are no mere repetition.

    First the amplitude grows along the path (n,), then there are waves of other periods. Both
    follow on a wave of `LEAST_TURNS` or more: they would make any curve of a slower one. `make`
    gives the columns (m, k) of some functions of the position, `rows` are those of the path.
    """

    def columns(theta: Theta) -> Array:
        return make(lambda p: [*waves(p, theta[0]), *others(p, theta[1:])])

    def growing(theta: Theta) -> Array:
        return make(lambda p: [grown(p, theta[1], *where) * w for w in waves(p, theta[0])])

    turning, where = own_or_turning(path, math.inf), travel(path)
    whole = replace(plain, columns=columns, phase=True, deepens=lambda theta: turning(theta[0]))
    several = with_waves(whole, path, lead, rows)
    grows = _growing(several, growing, where)
    return replace(several, richer=lambda: grows)


def _growing(plain: Term, columns: Callable[[Theta], Array], where: tuple[float, float]) -> Term:
    """A term whose θ has the growth of the amplitude, too."""
    propose, parameters = plain.propose, plain.parameters
    assert propose is not None
    place = dict(zip(('centre', 'half_range'), where, strict=True))
    return replace(
        plain,
        columns=columns,
        parameters=lambda theta, c: parameters(theta[:1], c) | {'growth': theta[1], **place},
        grid=tuple((*theta, 0.0) for theta in plain.grid),
        propose=lambda residual: tuple((*theta, 0.0) for theta in propose(residual)),
        lower=(*plain.lower, -1.0),
        upper=(*plain.upper, 1.0),
        admissible=lambda theta, c: plain.deepens(theta) and plain.admissible(theta, c),
        steps=(*plain.steps, GROWTH_STEP),
    )


def travel(path: Array) -> tuple[float, float]:
    """Middle and half of the travel of a path (n,) [m]."""
    return 0.5 * float(path.min() + path.max()), max(0.5 * float(np.ptp(path)), 1e-3)


def bounds(position: Array, lead: float = math.inf) -> tuple[float, float]:
    """Least and largest spatial frequency [1/m] of a position (n,): one period is travelled.

    With a `lead` [m] the largest is that of the finest cogging of a motor, too.
    """
    travel = max(float(np.ptp(position)), 1e-9)
    return 1.0 / travel, max(PERIODS / travel, ORDERS / lead)


def own_or_turning(
    position: Array, lead: float, turns: float = LEAST_TURNS
) -> Callable[[float], bool]:
    """Whether a spatial frequency [1/m] is the screw's own or turns often over the travel.

    Fewer turns of any other period are told from a smooth curve by nothing.
    """
    low, _ = bounds(position)

    def told(frequency: float) -> bool:
        own = abs(frequency - 1.0 / lead) < OWN_TURN * low
        # Three turns of the reference are a little less of what was travelled.
        return own or frequency > 0.97 * turns * low

    return told


def repeats(position: Array, frequency: float, residual: Array) -> bool:
    """Whether a wave has about the same amplitude and phase in both halves of the travel.

    Parameters
    ----------
    position : (n,) [m]
    frequency : spatial frequency [1/m], that of a periodogram (to `1 / PAD` turns)
    residual : (n,) in which the wave is looked for, beside a straight line
    """
    middle = 0.5 * (position.min() + position.max())
    turn, left = 1.0 / float(np.ptp(position)), position < middle

    def amplitude(rows: NDArray[np.bool_], own: float) -> tuple[complex, float]:
        place = position[rows] - middle
        matrix = np.column_stack([*others(place, (own,)), np.ones(len(place)), place])
        found, *_ = np.linalg.lstsq(matrix, residual[rows], rcond=None)
        rest = residual[rows] - matrix @ found
        return complex(found[0], found[1]), float(rest @ rest)

    near = frequency + np.linspace(-turn, turn, 2 * PAD + 1) / PAD
    best = min(near, key=lambda own: amplitude(position > -np.inf, own)[1])
    first, second = amplitude(left, best)[0], amplitude(~left, best)[0]
    return abs(first - second) < SAME * abs(first + second) / 2.0


def starts(
    position: Array, favourites: tuple[float, ...], lead: float = math.inf
) -> Callable[[Array], tuple[Theta, ...]]:
    """Spatial frequencies at which a residual over the position (n,) has the highest peaks.

    `favourites` [1/m] (of the screw) are always among them. A Fourier transform over fine bins of
    the position: the periodogram for unevenly spaced samples (Lomb, Astrophysics and Space
    Science 39, 1976).
    """
    from scipy.fft import next_fast_len

    low, high = bounds(position, lead)
    count = math.ceil(high / low)
    frequencies = np.arange(PAD, PAD * count) * (low / PAD)
    bins = next_fast_len(BINS * count, real=True)
    place = ((position - position.min()) * (bins * low)).astype(np.int64)

    def propose(residual: Array) -> tuple[Theta, ...]:
        sums = np.bincount(place, residual - residual.mean())
        power = np.abs(np.fft.rfft(sums, PAD * bins)[PAD : PAD * count])
        inner = (power[1:-1] >= power[:-2]) & (power[1:-1] > power[2:])
        peaks = np.flatnonzero(np.concatenate([[power[0] > power[1]], inner, [False]]))
        best = peaks[np.argsort(-power[peaks])][:PEAKS]
        known = [f for f in favourites if low <= f <= high]
        return tuple((float(f),) for f in (*known, *frequencies[best])) or ((low,),)

    return propose


def waves(position: Array, frequency: float, harmonics: int = HARMONICS) -> list[Array]:
    """Sine and cosine (n,) of each harmonic of a spatial frequency [1/m]."""
    angle = 2.0 * np.pi * frequency * position
    first = np.cos(angle) + 1j * np.sin(angle)
    turned, out = first, [first.imag, first.real]
    for _ in range(1, harmonics):
        turned = turned * first
        out += [turned.imag, turned.real]
    return out


def others(position: Array, frequencies: Theta) -> list[Array]:
    """Sine and cosine (n,) of each of some spatial frequencies [1/m]."""
    return [f(2.0 * np.pi * own * position) for own in frequencies for f in (np.sin, np.cos)]


def with_waves(plain: Term, path: Array, lead: float, rows: Rows, number: int = 0) -> Term:
    """A term of θ = (frequency,) that may have waves of other frequencies beside it, to `WAVES`.

    Each start is that with the highest peak of what the others leave at the `rows` of the path.
    """
    (low,), (high,) = plain.lower[:1], plain.upper[:1]
    assert plain.propose is not None
    proposed = starts(path, (), lead)

    def propose(residual: Array) -> tuple[Theta, ...]:
        assert plain.propose is not None
        residual, thetas = residual[rows], plain.propose(residual)
        first, left = _best(path, thetas, residual)
        theta = first
        for _ in range(number):
            peaks = [f[0] for f in proposed(left) if LEAST_TURNS * low <= f[0] <= high]
            theta = (*theta, peaks[0] if peaks else LEAST_TURNS * low)
            left = _left(path, theta, residual)
        return (theta,)

    def admissible(theta: Theta, c: Array) -> bool:
        known = [k * theta[0] for k in range(1, HARMONICS + 1)] + list(theta[1:])
        apart = np.diff(np.sort(known))
        near = float(apart.min()) <= 0.5 * low
        return not near and plain.deepens(theta) and plain.admissible(theta, c)

    slowest = (LEAST_TURNS * low,) * number
    more = number < WAVES and LEAST_TURNS * low < high
    return replace(
        plain,
        grid=((low, *slowest),),
        propose=propose if number else plain.propose,
        lower=(low, *slowest),
        upper=(high,) * (number + 1),
        steps=(PHASE_STEP * low,) * (number + 1),
        admissible=admissible if number else plain.admissible,
        nuisances=tuple(range(2 * (HARMONICS + number))),
        own=number == 1,
        richer=partial(with_waves, plain, path, lead, rows, number + 1) if more else None,
    )


def _best(path: Array, thetas: tuple[Theta, ...], residual: Array) -> tuple[Theta, Array]:
    """That of some θ which leaves least of a residual (n,), and what it leaves."""
    found = [(theta, _left(path, theta, residual)) for theta in thetas]
    return min(found, key=lambda pair: float(pair[1] @ pair[1]))


def _left(path: Array, theta: Theta, residual: Array) -> Array:
    columns = np.column_stack(
        [np.ones(len(path)), *waves(path, theta[0]), *others(path, theta[1:])]
    )
    solution, *_ = np.linalg.lstsq(columns.T @ columns, columns.T @ residual, rcond=1e-12)
    return np.asarray(residual - columns @ solution)


def found(theta: Theta, coefficients: Array) -> dict[str, float]:
    """Parameters of an effect from its spatial frequencies and the coefficients of its waves."""
    pairs = coefficients.reshape(-1, 2)
    count = len(pairs) - len(theta) + 1
    frequency, own = _fundamental(theta[0], pairs[:count])
    out = {'period': 1.0 / frequency}
    for k, pair in enumerate(own):
        out.update(_wave('', f'_{k + 1}' if k else '', pair))
    for k, pair in enumerate(pairs[count:]):
        out[f'wave_period{k + 1}'] = 1.0 / theta[k + 1]
        out.update(_wave('wave_', f'{k + 1}', pair))
    return out


def _wave(kind: str, number: str, pair: Array) -> dict[str, float]:
    sine, cosine = pair
    return {
        f'{kind}amplitude{number}': float(np.hypot(sine, cosine)),
        f'{kind}phase{number}': float(np.arctan2(cosine, sine)),
    }


def _fundamental(frequency: float, pairs: Array) -> tuple[float, Array]:
    """Frequency and harmonics (k, 2), as those of a higher one where it stands all but alone."""
    sizes = np.linalg.norm(pairs, axis=1)
    top = int(np.argmax(sizes))
    if top == 0 or np.delete(sizes, top).max() >= ALONE * sizes[top]:
        return frequency, pairs
    return (top + 1) * frequency, np.vstack([pairs[top], np.zeros((len(pairs) - 1, 2))])


def visible(columns: Array, least: float = 0.2) -> Array:
    """Columns (n, k) of unit waves, those that a low-pass has all but taken away set to zero."""
    kept = np.sqrt(np.mean(columns**2, axis=0)) > least * np.sqrt(0.5)
    return np.asarray(columns * kept)
