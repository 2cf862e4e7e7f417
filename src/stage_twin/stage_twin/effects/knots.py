"""Curves of the position through equally spaced knots, coarse to fine."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numba import njit

from stage_core.arrays import Array
from stage_twin.effects.definition import Parameter

#: What the mean square curvature of a force counts beside the mean square of what it leaves. Two
#: bumps that were passed once are predicted to 0.999 with it, and not at all without.
STIFF = 1e-7


@dataclass(frozen=True)
class Knots:
    """The parameters [N] of such a curve: c at `count` knots, and m and q between them.

    m is what is more half-way between two knots, q what is more half-way between all of these:
    they follow waves of half and of a quarter of the length that the knots follow.
    """

    count: int

    @property
    def numbers(self) -> tuple[int, int, int]:
        """Of parameters: c alone, with m, and with q."""
        return self.count, 2 * self.count - 1, 4 * self.count - 3

    @property
    def more(self) -> tuple[Parameter, ...]:
        """The parameters m and q."""
        gaps = self.count - 1
        meanings = [(f'm{k}', f'more half-way from knot {k} to the next') for k in range(gaps)]
        meanings += [(f'q{k}', f'more at odd quarter {k} between knots') for k in range(2 * gaps)]
        return tuple(Parameter(n, 'N', -5000.0, 5000.0, 0.0, said) for n, said in meanings)

    def named(self, values: Array) -> dict[str, float]:
        """The first parameters by their names, as many as there are values."""
        names = [*(f'c{k}' for k in range(self.count)), *(p.name for p in self.more)]
        return dict(zip(names, values.tolist(), strict=False))

    def roughness(self, number: int) -> Array:
        """What the squares of the first parameters count, see `Term.roughness`.

        `STIFF` times the integral of the square of the second derivative, over a travel of 2.
        """
        gaps = self.count - 1
        lengths = np.repeat([2.0 / gaps, 1.0 / gaps], [gaps, 2 * gaps])
        fine = STIFF * 32.0 / lengths**3
        return np.concatenate([np.zeros(self.count), fine])[:number]

    def units(self, curve: Callable[..., float], places: Array, number: int) -> Array:
        """Curves (number, n) of one unit of each of the first parameters.

        Parameters
        ----------
        curve : of a position [m], the first and the last knot's [m], and the arrays c, m and q
        places : (n,) [m] from the first knot to the last
        """
        *between, total = self.numbers
        levels = [np.split(unit, between) for unit in np.eye(total)[:number]]
        return np.array(
            [[curve(p, places[0], places[-1], *cmq) for p in places] for cmq in levels]
        )


@njit
def piece(position: float, start: float, stop: float, count: int) -> tuple[int, float]:
    """Which of `count` equal pieces between two ends, and the share of it; held beyond them."""
    at = min(max((position - start) / max(stop - start, 1e-9), 0.0), 1.0) * count
    k = min(int(at), count - 1)
    return k, at - k


@njit
def cubic(before: float, here: float, there: float, after: float, share: float) -> float:
    """Catmull and Rom's curve through four knots, between the second and the third."""
    slope, next_slope, rise = 0.5 * (there - before), 0.5 * (after - here), there - here
    bend = 3.0 * rise - 2.0 * slope - next_slope + share * (slope + next_slope - 2.0 * rise)
    return here + share * (slope + share * bend)


@njit(cache=True)
def smooth(position: float, start: float, stop: float, c: Array) -> float:
    """Cubic curve through the knots c, in their unit; held beyond the ends."""
    last = len(c) - 1
    k, share = piece(position, start, stop, last)
    before = c[k - 1] if k > 0 else 2.0 * c[k] - c[k + 1]
    after = c[k + 2] if k + 2 <= last else 2.0 * c[k + 1] - c[k]
    return cubic(before, c[k], c[k + 1], after, share)
