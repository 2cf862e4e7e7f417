"""What an effect adds to a residual: columns, their coefficients' meaning, a grid, bounds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from stage_core.arrays import Array

Theta = tuple[float, ...]


@dataclass(frozen=True, eq=False)
class Term:
    """One candidate effect as columns of a regression: separable, linear in most parameters.

    Attributes
    ----------
    columns : θ -> (n, k) columns for all rows of the problem
    parameters : (θ, coefficients) -> parameters of the twin's effect
    grid : starts for θ; a single empty tuple where the term is linear
    propose : residual (n,) -> starts for θ that it suggests, in place of a grid
    lower, upper : bounds of θ
    admissible : (θ, coefficients) -> whether they are physical
    usual : θ -> whether it is what machines have at these values; among effects that explain the
        same, one that is goes first
    fixed : whether θ says everything (a width, a delay): the one column has coefficient 1
    base : share (n,) of the effect that the nominal twin has already, left out of the target
    nuisances : indices of the columns whose coefficients belong to a session
    phase : whether the nuisances are the phases of pairs of sine and cosine, not their amplitudes
    steps : per θ a change that moves the columns by a little; empty where a thousandth of the
        range does
    richer : the same effect in the next richer shape, which goes on from the same θ, or from its
        own grid where it has more of them or they are its `own`; taken where the data bear it
    deepens : θ -> whether a richer shape may follow on this one there
    own : whether θ says something else than in the plainer shape
    holds : whether this shape holds the effect's special cases
    alone : whether nothing but its explaining all that is no noise speaks for it: a curve that
        other errors could have, and that no second channel shows
    answer : θ -> columns (n, k) that the encoder's noise alone makes, where a resonance lifts it
    misread : rows (n,) that the same noise makes by itself
    roughness : penalty (k,) on the square of each coefficient, which keeps a curve smooth where
        the rows do not tell it. Its unit is the sum of squares of the columns whose entry is zero;
        None: no penalty
    follows : largest share of an error that goes with the axis' own force that the columns follow
    acting : (θ, coefficients) -> force that acts per force that is asked for; residuals are
        compared in units of the latter, as a drive that gives nothing would leave nothing
    """

    columns: Callable[[Theta], Array]
    parameters: Callable[[Theta, Array], dict[str, float]]
    grid: tuple[Theta, ...] = ((),)
    propose: Callable[[Array], tuple[Theta, ...]] | None = None
    lower: Theta = ()
    upper: Theta = ()
    admissible: Callable[[Theta, Array], bool] = lambda theta, coefficients: True
    usual: Callable[[Theta], bool] = lambda theta: True
    fixed: bool = False
    base: Array | None = None
    nuisances: tuple[int, ...] = ()
    phase: bool = False
    steps: Theta = ()
    richer: Callable[[], Term] | None = None
    deepens: Callable[[Theta], bool] = lambda theta: True
    own: bool = False
    holds: bool = True
    alone: bool = False
    answer: Callable[[Theta], Array] | None = None
    misread: Callable[[], Array] | None = None
    roughness: Array | None = None
    follows: float = 1.0
    acting: Callable[[Theta, Array], float] = lambda theta, coefficients: 1.0

    @cached_property
    def next(self) -> Term | None:
        """The next richer shape, the same one each time; None of the richest."""
        return None if self.richer is None else self.richer()

    def penalty(self, squares: Array) -> Array:
        """Penalty (k,) on the square of each coefficient; `squares` (k,) are sums over columns."""
        if self.roughness is None:
            return np.zeros(len(squares))
        return self.roughness * float(np.sum(squares[self.roughness == 0.0]))

    def share(self, theta: Theta, coefficients: Array) -> Array:
        """What the effect explains of the target (n,): all of it, less what the twin has."""
        whole = self.columns(theta) @ coefficients
        return whole if self.base is None else whole - self.base


def constant(signal: Array) -> Callable[[Theta], Array]:
    """Columns that depend on no θ."""
    return lambda theta: signal
