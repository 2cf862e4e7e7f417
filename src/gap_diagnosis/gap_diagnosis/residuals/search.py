"""What sets of terms leave of the fit rows while their nonlinear parameters are searched.

A step of the search moves few of the columns. Those of the others, and the products of pairs of
terms, are kept, so that a step costs what has moved.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from gap_diagnosis.residuals.normal import solve_gram
from stage_core.arrays import Array
from stage_twin.effects.term import Term, Theta


class Recent:
    """Arrays that were made last, as many as fit into some bytes."""

    def __init__(self, most: int) -> None:
        self._most, self._held = most, 0
        self._kept: OrderedDict[Any, Array] = OrderedDict()

    def once(self, key: Any, make: Callable[[], Array]) -> Array:
        """The array of a key, made where it is not kept."""
        if key in self._kept:
            self._kept.move_to_end(key)
            return self._kept[key]
        made = make()
        self._kept[key] = made
        self._held += made.nbytes
        while self._held > self._most and len(self._kept) > 1:
            self._held -= self._kept.popitem(last=False)[1].nbytes
        return made

    def clear(self) -> None:
        """Keep nothing."""
        self._kept.clear()
        self._held = 0


class Search:
    """Residuals (n,) of the fit rows of sets of terms.

    `columns` gives those of a term (n, k) on the fit rows, `target` (n,) is that of the whole
    set.
    """

    def __init__(
        self,
        target: Array,
        columns: Callable[[str, Theta], Array],
        terms: Mapping[str, Term],
        most: int,
    ) -> None:
        self._target, self._make, self._terms = target, columns, terms
        self._columns, self._products = Recent(most), Recent(most)

    def residual(self, thetas: dict[str, Theta]) -> Array:
        """What a set leaves with its best coefficients."""
        target, free = self._target, []
        for name, theta in thetas.items():
            if self._terms[name].fixed:
                target = target - self._own(name, theta)[:, 0]
            else:
                free.append((name, theta))
        if not free:
            return target
        owns = [self._own(*one) for one in free]
        ends = np.cumsum([own.shape[1] for own in owns]).tolist()
        places = [slice(*pair) for pair in zip([0, *ends], ends, strict=False)]
        gram, right, penalty = np.empty((ends[-1], ends[-1])), np.empty(ends[-1]), []
        for i, (at, own) in enumerate(zip(places, owns, strict=True)):
            for j in range(i + 1):
                product = self._product(free[i], free[j])
                gram[at, places[j]], gram[places[j], at] = product, product.T
            right[at] = own.T @ target
            squares = gram[at, at].diagonal()
            penalty.append(self._terms[free[i][0]].penalty(squares))
        solution = solve_gram(gram, right, np.concatenate(penalty))
        for at, own in zip(places, owns, strict=True):
            target = target - own @ solution[at]
        return target

    def _own(self, name: str, theta: Theta) -> Array:
        return self._columns.once((name, theta), lambda: self._make(name, theta))

    def _product(self, one: tuple[str, Theta], other: tuple[str, Theta]) -> Array:
        if one[0] > other[0]:
            return self._product(other, one).T
        return self._products.once((one, other), lambda: self._own(*one).T @ self._own(*other))
