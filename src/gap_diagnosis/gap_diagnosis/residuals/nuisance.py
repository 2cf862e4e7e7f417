"""Columns that are partialled out of a whole regression problem.

A regression beside columns whose coefficients nobody asks for is the same as one of which these
columns were taken out on both sides (Frisch and Waugh, Econometrica 1, 1933): an effect keeps
only what they cannot imitate, and its interval widens.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from gap_diagnosis.residuals.problem import Problem
from stage_core.arrays import Array
from stage_twin.effects.term import Term, Theta

#: Of the largest singular value, below which a direction of the columns is rounding.
RANK = 1e-7


def without_nuisances(problem: Problem, columns: Array) -> Problem:
    """The problem with columns (n, k) partialled out by what the rows that fit say."""
    scaled = columns / (np.linalg.norm(columns[problem.fit], axis=0) + 1e-300)
    inverse = np.linalg.pinv(scaled[problem.fit], rcond=RANK)

    def free(rows: Array) -> Array:
        return np.asarray(rows - scaled @ (inverse @ rows[problem.fit]))

    return replace(
        problem,
        target=free(problem.target),
        terms={name: _free(term, free) for name, term in problem.terms.items()},
        signatures={n: partial(_called, free, s) for n, s in problem.signatures.items()},
    )


def _called(free: Callable[[Array], Array], make: Callable[[], Array]) -> Array:
    return free(make())


def _free(term: Term, free: Callable[[Array], Array]) -> Term:
    def columns(theta: Theta) -> Array:
        return free(term.columns(theta))

    def richer() -> Term:
        assert term.next is not None
        return _free(term.next, free)

    return replace(
        term,
        columns=columns,
        base=None if term.base is None else free(term.base),
        richer=None if term.richer is None else richer,
    )
