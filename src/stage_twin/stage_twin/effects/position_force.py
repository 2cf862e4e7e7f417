"""Gravity, a counterweight, any smooth force of the position that is no cable chain."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
from numba import njit

from stage_core.arrays import Array
from stage_twin.effects.definition import Effect, Parameter
from stage_twin.effects.knots import Knots, cubic, piece, smooth
from stage_twin.effects.rows import ForceRows
from stage_twin.effects.term import Term, Theta, constant

KNOTS = Knots(9)  # the shortest wave that they follow is a quarter of the travel
PARTS = (2, 4, 8)  # of the travel: on one of them, or half-way between two, a force may change
BINS = 320  # of the travel, in which such a part is looked for
STARTS = 3  # of them that are fitted
#: Share of what a curve over the whole travel leaves that the best such part does. Where the force
#: changed on a part it was 0.004 and 0.04, else 0.9 and more.
LEFT = 0.5

EFFECT = Effect(
    name='position_force',
    link='servo',
    parameters=(
        Parameter('start', 'm', -20.0, 20.0, 0.0, 'position of the first knot', neutral=None),
        Parameter('stop', 'm', -20.0, 20.0, 0.01, 'position of the last knot', neutral=None),
        *(
            Parameter(f'c{k}', 'N', -5000.0, 5000.0, 0.5 * (k - 4.5), f'force at knot {k}')
            for k in range(KNOTS.count)
        ),
        *KNOTS.more,
    ),
    model='Force on the moving mass through equally spaced knots over the position, cubic between '
    'them, plus a curve of this kind that is zero at the knots and m half-way between, and one '
    'that is zero at all of these and q half-way between them. Catmull and Rom, "A class of local '
    'interpolating splines" (1974).',
    sentence='a force that depends on the position pulls the axis: {c0} at one end of the '
    'travel, {c8} at the other',
    excited_by='slow strokes over the whole travel in both directions',
    holds=('cable_force', 'force_offset'),
    # A ripple of several waves beside it is what its knots do not follow.
    merges=('position_force', 'force_ripple'),
    along_travel=True,
)


def force(position: float, start: float, stop: float, c: Array, m: Array, q: Array) -> float:
    """Force on the moving mass [N]; held beyond the ends."""
    fine = _between(position, start, stop, m) + _between(position, start, stop, q)
    return smooth(position, start, stop, c) + fine


@njit(cache=True)
def _between(position: float, start: float, stop: float, m: Array) -> float:
    """Curve that is zero at each other knot [N]."""
    k, share = piece(position, start, stop, 2 * len(m))
    return cubic(_fine(m, k - 1), _fine(m, k), _fine(m, k + 1), _fine(m, k + 2), share)


@njit(cache=True)
def _fine(m: Array, k: int) -> float:
    """Such a curve at knot k: zero at every other one, and mirrored at the ends."""
    if k % 2 == 0:
        return 0.0
    if k < 0:
        return -m[0]
    return m[k // 2] if k < 2 * len(m) else -m[-1]


def term(rows: ForceRows) -> Term:
    """The curve of one newton at each knot; one that hardly varies is a constant force.

    Richer are one with middles, both on a part of the travel alone, and one with quarters.
    """
    plain, halved = (_Curve(rows, number) for number in KNOTS.numbers[:2])
    within = partial(_within, plain, partial(_within, halved, partial(_finest, rows)))
    return plain.term(partial(halved.term, within))


class _Curve:
    """The curves of the first `number` of the knots, the middles and the quarters."""

    def __init__(self, rows: ForceRows, number: int) -> None:
        self.rows, self.path = rows, rows.used(rows.position())
        told = rows.fitted(rows.position())
        self.low, self.high = float(told.min()), float(told.max())
        self.shares = np.linspace(0.0, 1.0, 80 * (KNOTS.count - 1) + 1)
        self.curves = KNOTS.units(_whole, self.shares, number)

    def columns(self, theta: Theta) -> Array:
        """Columns (n, k) of a stretch of the travel, of the whole without θ."""
        start, stop = self.stretch(theta)
        shares = [(p - start) / (stop - start) for p in self.rows.position()]
        return self.rows.columns(
            *([-np.interp(share, self.shares, own) for share in shares] for own in self.curves)
        )

    def stretch(self, theta: Theta) -> tuple[float, float]:
        """Start and stop [m] of the curve."""
        start, stop = theta or (self.low, self.high)
        return start, max(stop, start + (self.high - self.low) / (2 * PARTS[-1]))

    def term(self, richer: Callable[[], Term] | None) -> Term:
        """The curve over the whole travel."""
        return Term(
            constant(self.columns(())),
            self._parameters,
            admissible=lambda theta, c: (
                5.0 * float(np.ptp(c[: KNOTS.count])) > float(np.max(np.abs(c[: KNOTS.count])))
            ),
            richer=richer,
            roughness=KNOTS.roughness(len(self.curves)),
        )

    def _parameters(self, theta: Theta, c: Array) -> dict[str, float]:
        start, stop = self.stretch(theta)
        return {'start': start, 'stop': stop, **KNOTS.named(c)}


def _finest(rows: ForceRows) -> Term:
    return replace(_Curve(rows, KNOTS.numbers[-1]).term(None), own=True)


def _within(curve: _Curve, richer: Callable[[], Term] | None) -> Term:
    """A curve that bends on a part of the travel alone, and is held beyond it."""
    low, high = curve.low, curve.high
    places = np.linspace(0.0, 1.0, BINS)
    shares = np.clip((curve.path - low) / (high - low), 0.0, 1.0)
    at = (shares * (BINS - 1)).round().astype(np.int64)
    stretches = [
        (low + k * (high - low) / (2 * parts), low + (k + 2) * (high - low) / (2 * parts))
        for parts in PARTS
        for k in range(2 * parts - 1)
    ]

    def propose(residual: Array) -> tuple[Theta, ...]:
        """Parts of the travel that explain far more than the whole one, which stands else."""
        number = np.bincount(at, minlength=BINS)
        mean = np.bincount(at, residual, BINS) / np.maximum(number, 1)
        weight = np.sqrt(number)

        def left(stretch: tuple[float, float]) -> float:
            share = (low + places * (high - low) - stretch[0]) / (stretch[1] - stretch[0])
            matrix = np.column_stack([np.interp(share, curve.shares, c) for c in curve.curves])
            matrix, target = matrix * weight[:, None], mean * weight
            found = np.linalg.lstsq(matrix, target, rcond=1e-6)[0]
            return float(np.sum((target - matrix @ found) ** 2))

        best = sorted(stretches, key=left)[:STARTS]
        return tuple(best) if left(best[0]) < LEFT * left((low, high)) else ((low, high),)

    plain = curve.term(richer)
    return replace(
        plain, columns=curve.columns, propose=propose, lower=(low, low), upper=(high, high)
    )


_whole = njit(cache=True)(force)
