"""Separable regression: candidate terms with few nonlinear parameters, linear in the rest.

A residual is explained by a set of terms. Each term gives columns for its nonlinear
parameters θ (a width, a delay, a corner velocity); the coefficients of the columns follow from
linear least squares (variable projection, Golub and Pereyra, SIAM J. Numer. Anal. 10, 1973).
Evidence for a term is the gain of its set on rows that no fit has seen.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from gap_diagnosis.residuals.foreseen import BELIEVED, counted, variances
from gap_diagnosis.residuals.normal import predicts, solve, solve_gram
from gap_diagnosis.residuals.problem import Problem
from gap_diagnosis.residuals.search import Recent, Search
from gap_diagnosis.residuals.shared_columns import yield_shared
from gap_diagnosis.residuals.starts import Grid, Grids
from stage_core.arrays import Array
from stage_twin.effects.term import Theta

FOLD, FOLDS = 2.0, 6  # s, and number of the folds of cross-validation
KEPT = 96 << 20  # bytes of columns that a search may need again


@dataclass
class Fit:
    """A fitted set of terms; `residual` covers all rows.

    `crossed` is the residual in which no row is judged by coefficients that it helped to fit:
    held-out rows by those of the fit rows, these by those of the other folds. Rare events (a few
    reversals, one saturation) then count wherever they happen. Beside a smooth curve its squares
    count how surely a row was foreseen, too: `variance` (n,) is that of the error of a held-out
    row over its noise, 1 where no curve is in doubt or none is believed. `crossed` is in units of
    the force that is asked for, also where the drive gives less (`Term.acting`). `sessions`
    holds, per held-out session, the coefficients whose nuisances were refitted on its prefix.
    """

    thetas: dict[str, Theta]
    coefficients: dict[str, Array]
    residual: Array
    crossed: Array
    sessions: dict[int, dict[str, Array]] = field(default_factory=dict)
    variance: Array | float = 1.0

    @property
    def size(self) -> int:
        """Number of free parameters."""
        return sum(len(t) + len(self.coefficients[n]) for n, t in self.thetas.items())

    def mean_square(self, problem: Problem) -> float:
        """Mean square of the residual on the rows that judge."""
        return float(np.mean(self.crossed[problem.judged] ** 2))

    def contribution(self, problem: Problem, name: str) -> Array:
        """What a term of the set explains of the target, on all rows (n,)."""
        return problem.terms[name].share(self.thetas[name], self.coefficients[name])


class Regression:
    """Fits sets of terms to one problem; columns are kept, as many sets share them."""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self._kept, self._grids = Recent(KEPT), Grids()
        self._freed: tuple[Fit, Array] | None = None
        folds = (problem.time / FOLD).astype(np.int64) % FOLDS
        # Row numbers of each fold, and of its rows that fit.
        self._folds = [
            (np.flatnonzero(folds == k), np.flatnonzero((folds == k) & problem.fit))
            for k in range(FOLDS)
        ]
        self.fit_rows = np.flatnonzero(problem.fit)
        self._rest = np.flatnonzero(~problem.fit)

    def columns(self, name: str, theta: Theta) -> Array:
        """Columns (n, k) of a term; the last ones are kept."""
        make = self.problem.terms[name].columns  # another one where the term became richer
        key = (make, tuple(round(t, 15) for t in theta))
        return self._kept.once(key, lambda: self.problem.whiten(make(theta)))

    def forget(self) -> None:
        """Keep no columns: the search is over."""
        self._kept.clear()
        self._grids.clear()
        self._freed = None

    def _base(self, name: str) -> Array | float:
        """What goes back into the target with a term; whitened as it is."""
        base = self.problem.terms[name].base
        return 0.0 if base is None else self.problem.whiten(base)

    def linear(self, thetas: dict[str, Theta]) -> Fit:
        """Coefficients of a set with its nonlinear parameters held."""
        problem = self.problem
        if not thetas:
            return Fit({}, {}, problem.target.copy(), problem.target)
        target = problem.target.copy()
        coefficients: dict[str, Array] = dict.fromkeys(thetas, np.ones(1))
        free: list[tuple[str, Array]] = []
        for name, theta in thetas.items():
            part = self.columns(name, theta)
            target += self._base(name)
            if problem.terms[name].fixed:
                target -= part[:, 0]
            else:
                free.append((name, part))
        if not free:
            return Fit(dict(thetas), coefficients, target, target)
        matrix = np.hstack([part for _, part in free])
        fitted = matrix.take(self.fit_rows, axis=0)
        gram, right = fitted.T @ fitted, fitted.T @ target[self.fit_rows]
        penalty = self._penalty(free, np.diag(gram))
        solution = solve_gram(gram, right, penalty)
        at = 0
        for name, part in free:
            coefficients[name] = solution[at : at + part.shape[1]]
            at += part.shape[1]
        yield_shared(problem.terms, free, coefficients)
        residual = target - matrix @ solution
        sessions = self._refit_nuisances(thetas, coefficients, residual)
        judged = [(self._rest, gram, solution)]
        judged += self._folded(matrix, target, penalty) if problem.crossable else []
        noise, crossed, variance = problem.floor**2, residual.copy(), np.ones(len(residual))
        # A curve that is far off where it was fitted, or beside a drift, is believed nowhere else.
        near = np.mean(residual[self.fit_rows] ** 2) < BELIEVED * noise
        believed = penalty.any() and near and not problem.whitening
        for rows, known, found in judged:
            if found is solution and not believed:
                continue
            own = matrix.take(rows, axis=0)
            # Phases and offsets of a held-out session are refitted in its residual.
            if found is not solution:
                crossed[rows] = target[rows] - own @ found
            if believed:
                variance[rows] = variances(own, known, penalty, found, noise)
                crossed[rows] = counted(crossed[rows], variance[rows], noise)
        crossed = crossed / self._acting(thetas, coefficients)
        variance[self.fit_rows] = 1.0
        return Fit(dict(thetas), coefficients, residual, crossed, sessions, variance)

    def _acting(self, thetas: dict[str, Theta], coefficients: dict[str, Array]) -> float:
        """Force that acts per force that is asked for, above zero."""
        terms = self.problem.terms
        lost = sum(1.0 - terms[n].acting(t, coefficients[n]) for n, t in thetas.items())
        return max(1.0 - lost, 1e-3)

    def _penalty(self, parts: list[tuple[str, Array]], squares: Array) -> Array:
        """What the squares of the coefficients (k,) of columns with such squares (k,) count."""
        ends = np.cumsum([part.shape[1] for _, part in parts])[:-1]
        own = zip(parts, np.split(squares, ends), strict=True)
        return np.concatenate([self.problem.terms[name].penalty(s) for (name, _), s in own])

    def _folded(
        self, matrix: Array, target: Array, penalty: Array
    ) -> list[tuple[NDArray[np.int64], Array, Array]]:
        """The rows of each fold that fit, and the Gram matrix and coefficients of the others.

        Folds are windows of two seconds dealt out in turn; their Gram matrices add up, so that a
        fold is left out by a subtraction.
        """
        parts = []
        for own, rows in self._folds:
            mine = matrix.take(own, axis=0)
            parts.append((rows, mine.T @ mine, mine.T @ target[own]))
        gram = sum(part[1] for part in parts)
        right = sum(part[2] for part in parts)
        return [
            (rows, gram - own, solve_gram(gram - own, right - own_right, penalty))
            for rows, own, own_right in parts
        ]

    def _refit_nuisances(
        self, thetas: dict[str, Theta], coefficients: dict[str, Array], residual: Array
    ) -> dict[int, dict[str, Array]]:
        """Refit phases and offsets once per held-out session, on its unscored prefix.

        They stay where a prefix is too short to predict its own other half better. What is
        physical carries over: a pair of sine and cosine keeps its amplitude. Changes `residual`
        on the rows of these sessions.
        """
        problem = self.problem
        names = [n for n in thetas if problem.terms[n].nuisances]
        found: dict[int, dict[str, Array]] = {}
        if problem.crossable or not names:
            return found
        prefix = ~(problem.fit | problem.held_out)
        chosen = [list(problem.terms[n].nuisances) for n in names]
        columns = np.hstack(
            [self.columns(n, thetas[n])[:, c] for n, c in zip(names, chosen, strict=True)]
        )
        old = np.concatenate([coefficients[n][c] for n, c in zip(names, chosen, strict=True)])
        for number in np.unique(problem.record[problem.held_out]).tolist():
            rows = problem.record == number
            at = np.flatnonzero(rows & prefix)
            if len(at) < max(12, 4 * len(old)):
                continue
            own, target = columns[at], residual[at] + columns[at] @ old
            if not predicts(own, target, old):
                continue
            new, start, found[number] = solve(own, target), 0, {}
            for name, which in zip(names, chosen, strict=True):
                part = slice(start, start + len(which))
                start += len(which)
                if problem.terms[name].phase:
                    pairs = new[part].reshape(-1, 2)  # a view: sine and cosine of each period
                    size = np.linalg.norm(old[part].reshape(-1, 2), axis=1)
                    pairs *= (size / np.maximum(np.linalg.norm(pairs, axis=1), 1e-300))[:, None]
                changed = coefficients[name].copy()
                changed[which] = new[part]
                found[number][name] = changed
            residual[rows] -= columns[rows] @ (new - old)
        return found

    def warm_start(self, base: Fit, name: str) -> Theta:
        """Grid point of a term that explains most of what a fitted set leaves on the fit rows."""
        key = 'start', self.problem.terms[name], self._set(base.thetas)
        return self.problem.tried.once(key, lambda: self._started(base, name))

    def _set(self, thetas: dict[str, Theta]) -> Hashable:
        """What tells a set from all others of the problem: its shapes and their parameters."""
        terms = self.problem.terms
        return self.problem.whitening, *((terms[name], theta) for name, theta in thetas.items())

    def _started(self, base: Fit, name: str) -> Theta:
        term = self.problem.terms[name]
        everywhere = base.residual + self._base(name)
        thetas = term.grid if term.propose is None else term.propose(everywhere)
        if len(thetas) == 1:
            return thetas[0]
        rows = self.fit_rows

        def own(theta: Theta) -> Array:
            return self.columns(name, theta).take(rows, axis=0)

        kept = term.propose is None
        grid = self._grids.of(term, own) if kept else Grid.of([own(theta) for theta in thetas])
        return grid.best(term, thetas, everywhere[rows], self._orthonormal(base))

    def _orthonormal(self, base: Fit) -> Array:
        """Orthonormal columns (n, k) of what the last set spans on the fit rows."""
        if self._freed is None or self._freed[0] is not base:
            free = [n for n in base.thetas if not self.problem.terms[n].fixed]
            parts = [self.columns(n, base.thetas[n]).take(self.fit_rows, axis=0) for n in free]
            matrix = np.hstack([np.zeros((len(self.fit_rows), 0)), *parts])
            scaled = matrix / (np.linalg.norm(matrix, axis=0) + 1e-300)
            self._freed = base, np.linalg.qr(scaled)[0]
        return self._freed[1]

    def refine(self, thetas: dict[str, Theta], names: Sequence[str], rounds: int = 12) -> Fit:
        """Set with the nonlinear parameters of `names` at a least-squares minimum on the fit rows.

        A set that was refined before, in another pass perhaps, is not searched again.
        """
        free = [(n, i) for n in names for i in range(len(self.problem.terms[n].lower))]
        if not free:
            return self.linear(thetas)
        key = 'refined', self._set(thetas), tuple(names), rounds
        found = self.problem.tried.once(key, lambda: self._searched(thetas, free, rounds))
        return self.linear(found)

    def _searched(
        self, thetas: dict[str, Theta], free: list[tuple[str, int]], rounds: int
    ) -> dict[str, Theta]:
        """The set at its minimum over some θ, by the name and the index of each.

        Bounded trust-region Gauss-Newton on θ scaled to its range.
        """
        terms = self.problem.terms
        low = np.array([terms[n].lower[i] for n, i in free])
        span = np.array([terms[n].upper[i] for n, i in free]) - low
        start = np.clip((np.array([thetas[n][i] for n, i in free]) - low) / span, 1e-4, 1 - 1e-4)

        def unpack(z: Array) -> dict[str, Theta]:
            values = {n: list(t) for n, t in thetas.items()}
            for (n, i), value in zip(free, low + span * z, strict=True):
                values[n][i] = float(value)
            return {n: tuple(v) for n, v in values.items()}

        rows = self.fit_rows
        target = self.problem.target + sum(self._base(n) for n in thetas)
        search = Search(
            target[rows],
            lambda name, theta: self.columns(name, theta).take(rows, axis=0),
            terms,
            KEPT,
        )

        def residual(z: Array) -> Array:
            return search.residual(unpack(z))

        scale = float(np.std(residual(start))) or 1.0
        steps = np.array([terms[n].steps[i] if terms[n].steps else np.nan for n, i in free])
        result = least_squares(
            lambda z: residual(z) / scale,
            start,
            bounds=(0.0, 1.0),
            diff_step=np.where(np.isnan(steps), 2e-3, steps / span / start),
            max_nfev=rounds,
            xtol=1e-4,
            ftol=1e-5,
        )
        return unpack(np.asarray(result.x))
