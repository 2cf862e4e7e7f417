"""Where the search of a term's nonlinear parameters starts: the best point of its grid.

A grid is asked beside each set that a selection tries, but its columns are the same each time. So
they are made once and kept, and what a set explains of them is taken out of their products only.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from gap_diagnosis.residuals.normal import solve_gram
from stage_core.arrays import Array
from stage_twin.effects.term import Term, Theta

KEPT = 512 << 20  # bytes of the columns of grids
#: Share of a column's square that a set leaves, below which the difference of products is too
#: rough: rounding makes 1e-16 of the whole.
ROUGH = 1e-4


@dataclass(frozen=True)
class Grid:
    """Columns of all points θ of a grid on the fit rows.

    Attributes
    ----------
    columns : (n, k), those of one point after those of another
    points : which of them each point has
    products : Gram matrix of each point's own
    """

    columns: Array
    points: list[slice]
    products: list[Array]

    @classmethod
    def of(cls, parts: Sequence[Array]) -> Grid:
        """The grid whose points have these columns (n, k) each."""
        ends = np.cumsum([0, *(part.shape[1] for part in parts)]).tolist()
        points = [slice(*pair) for pair in zip(ends[:-1], ends[1:], strict=True)]
        return cls(np.hstack(parts), points, [part.T @ part for part in parts])

    def best(self, term: Term, thetas: Sequence[Theta], residual: Array, taken: Array) -> Theta:
        """That of the points which explains most of a residual (n,).

        Columns are freed of what `taken`, orthonormal columns (n, m), explains of them (Frisch,
        Waugh, Lovell). A start with impossible values leads to none that are possible.
        """
        shares = taken.T @ self.columns
        right = residual @ self.columns - (residual @ taken) @ shares
        solutions, explained = [], []
        for point, whole in zip(self.points, self.products, strict=True):
            share, along = shares[:, point], right[point]
            gram = whole - share.T @ share
            if np.any(np.diag(gram) < ROUGH * np.diag(whole)):
                freed = self.columns[:, point] - taken @ share
                gram, along = freed.T @ freed, residual @ freed
            # Of a fixed one ||r||² - ||r - c||², r being free of the set's columns already.
            penalty = term.penalty(np.diag(whole))
            solutions.append(np.ones(1) if term.fixed else solve_gram(gram, along, penalty))
            most = 2.0 * along[0] - gram[0, 0] if term.fixed else along @ solutions[-1]
            explained.append(float(most))
        order = np.argsort(-np.array(explained), kind='stable').tolist()
        possible = (i for i in order if term.admissible(thetas[i], solutions[i]))
        return thetas[next(possible, order[0])]


class Grids:
    """The grids of terms, kept as long as they fit into memory."""

    def __init__(self) -> None:
        self._kept: dict[Term, Grid] = {}
        self._free = KEPT

    def of(self, term: Term, columns: Callable[[Theta], Array]) -> Grid:
        """The grid of a term whose points have some `columns` (n, k)."""
        if term in self._kept:
            return self._kept[term]
        grid = Grid.of([columns(theta) for theta in term.grid])
        if grid.columns.nbytes <= self._free:
            self._free -= grid.columns.nbytes
            self._kept[term] = grid
        return grid

    def clear(self) -> None:
        """Keep nothing."""
        self._kept.clear()
        self._free = KEPT
