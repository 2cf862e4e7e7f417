"""The sparse regression: a sum of few candidates, grown and pruned on rows that did not fit it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from gap_diagnosis.residuals.problem import Problem
from gap_diagnosis.residuals.regression import Fit, Regression
from gap_diagnosis.selection.gains import block_rms_gains, bootstrap_interval
from stage_twin.effects.law_terms import EVEN, LINEAR, ODD, PLAIN, TERMS

#: Candidates whose nonlinear parameters are refined after the grid has ranked them.
REFINED = 6
#: Among candidates that gain about the same, the one with fewer numbers is taken.
ABOUT_THE_SAME = 0.98
#: Least share of what the law so far leaves above the noise that one more term must take.
OF_REST = 0.10
#: Mean squares of the noise, over the number of rows, that one more term must take: the best of
#: the basis took up to 14 from noise alone, in 325 draws of 800 rows of a tracker.
OF_NOISE = 20.0
#: Of the bootstrap interval of a term's gain: some fifty candidates are looked at.
LEVEL = 0.998


def sound(names: Iterable[str]) -> bool:
    """Whether a law of such terms explains more than 0 = 0.

    The balance is the drive's force less what accelerates the mass: a law of both takes it back.
    """
    variables = {part.partition(':')[0] for n in names for part in n.split()[0].split('*')}
    return not {'a', 'F'} <= variables


@dataclass(frozen=True)
class Search:
    """Grows a law for one problem; deterministic for a seed."""

    regression: Regression
    seed: int

    @property
    def problem(self) -> Problem:
        """Rows and candidates."""
        return self.regression.problem

    def grow(self, most: int) -> Fit:
        """The law of at most so many terms; an empty one where none counts."""
        base = self.regression.linear({})
        while len(base.thetas) < most:
            best = self._next(base)
            if best is None:
                break
            grown = self._pruned(self.regression.refine(best.thetas, list(best.thetas)))
            if len(grown.thetas) > TERMS or set(grown.thetas) <= set(base.thetas):
                break
            base = grown
        return base

    def _next(self, base: Fit) -> Fit | None:
        """The law with more of a law, the plainest of what gains most."""
        more = [(n,) for n in self.problem.terms if n not in base.thetas] + self._shared(base)
        trials = [self._with(base, names) for names in more if sound((*base.thetas, *names))]
        trials.sort(key=lambda fit: -self._gain(base, fit))
        refined = []
        for trial in trials[:REFINED]:
            new = [n for n in trial.thetas if n not in base.thetas]
            fit = self.regression.refine(trial.thetas, new, rounds=8)
            refined.append((self._gain(base, fit), self._size(fit), fit))
        most = max((gain for gain, *_ in refined), default=0.0)
        near = [r for r in refined if r[0] >= ABOUT_THE_SAME * most and self._counts(base, r[2])]
        return min(near, key=lambda r: (r[1], -r[0]))[2] if near else None

    def _shared(self, base: Fit) -> list[tuple[str, ...]]:
        """Powers beside the named effects' plain shapes of the same variable, their power last.

        A named effect may have taken its share of what is a power: what it leaves is then the
        power less a line (viscous friction, scale), a step (Coulomb) or a constant (offset).
        """
        out = []
        for name in self.problem.terms:
            variable, _, kind = name.partition(':')
            partners = {
                str(ODD): (f'{variable}:{LINEAR}', *([f's:{LINEAR}'] if variable == 'v' else [])),
                str(EVEN): (f'1:{PLAIN}',),
            }.get(kind, ())
            new = [n for n in (*partners, name) if n not in base.thetas]
            if 1 < len(new) == len([n for n in new if n in self.problem.terms]):
                out.append(tuple(new))
        return out

    def _with(self, base: Fit, names: tuple[str, ...]) -> Fit:
        """The law with some candidates more, each at the start that explains most."""
        for name in names:
            theta = self.regression.warm_start(base, name)
            base = self.regression.linear({**base.thetas, name: theta})
        return base

    def _gain(self, base: Fit, fit: Fit) -> float:
        return base.mean_square(self.problem) - fit.mean_square(self.problem)

    @staticmethod
    def _size(fit: Fit) -> int:
        """Numbers that a law has."""
        return sum(len(t) + len(fit.coefficients[n]) for n, t in fit.thetas.items())

    def _counts(self, less: Fit, fit: Fit) -> bool:
        noise = self.problem.floor**2
        rest = max(less.mean_square(self.problem) - noise, 0.1 * noise)
        gains = block_rms_gains(self.problem, less, fit)
        low, _ = bootstrap_interval(gains, self.seed, level=LEVEL)
        least = max(OF_REST * rest, OF_NOISE * noise / np.count_nonzero(self.problem.judged))
        return low > 0.0 and self._gain(less, fit) > least

    def _pruned(self, fit: Fit) -> Fit:
        """The law without the terms that the later ones made needless."""
        while len(fit.thetas) > 1:
            rests = {n: self._without(fit, n) for n in fit.thetas}
            weak = [n for n, less in rests.items() if not self._counts(less, fit)]
            if not weak:
                break
            fit = rests[min(weak, key=lambda n: self._gain(rests[n], fit))]
        return fit

    def _without(self, fit: Fit, name: str) -> Fit:
        kept = {n: t for n, t in fit.thetas.items() if n != name}
        return self.regression.refine(kept, list(kept), rounds=4)
