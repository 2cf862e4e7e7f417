"""What an accepted effect is made of: the special cases that it holds, added one by one.

An asymmetric friction holds viscous and Coulomb friction and an offset of the force; naming
these beside it would count them twice. So each is a rung: what it gains on rows that did not fit
it, with its parameters in the fit of all plain ones. What the effect has beyond them is the last
rung, and the reversal zone is judged beside it: pre-sliding, and friction that falls with speed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gap_diagnosis.evidence.describe import describe
from gap_diagnosis.evidence.judgement import Rung
from gap_diagnosis.parameters import Parameters
from gap_diagnosis.residuals.problem import Problem
from gap_diagnosis.residuals.regression import Fit, Theta
from gap_diagnosis.selection.gains import weights
from gap_diagnosis.selection.model import Selection
from gap_diagnosis.selection.parts import Part
from stage_twin.effects import EFFECTS

DRAWS = 500  # of the bootstrap over blocks
#: Order in which rungs are added: the plain ones of the servo link as the EMPS ladder has them.
ORDER = ('viscous_friction', 'coulomb_friction', 'force_offset', 'scale_error')
STRIBECK, PRESLIDING = 'stribeck_friction', 'presliding'


@dataclass
class _Ladder:
    part: Part
    seed: int

    def rung(
        self, effect: str, base: Fit, fit: Fit, parameters: dict[str, tuple[float, float]]
    ) -> Rung:
        """The step from one fit to another on the rows that judge."""
        problem = self.part.problem
        rows = problem.judged
        labels = np.unique(problem.block[rows], return_inverse=True)[1]
        sides = np.stack([np.bincount(labels, weights=f.crossed[rows] ** 2) for f in (base, fit)])
        before, after = sides @ weights(self.seed, DRAWS, sides.shape[1]).T
        low, high = np.percentile(1.0 - np.sqrt(after / before), [2.5, 97.5])
        return Rung(
            effect,
            float(np.sqrt(base.mean_square(problem))),
            float(np.sqrt(fit.mean_square(problem))),
            (float(low), float(high)),
            parameters,
        )

    def parameters(self, fit: Fit, names: list[str]) -> Parameters:
        """Parameters of some effects of a fit, with their standard deviations."""
        whole = Selection(list(fit.thetas), fit, {}, {})
        found = describe(whole, self.part.selector.regression)
        return {name: found[name] for name in names}


def contained(part: Part | None, name: str, seed: int) -> list[Rung]:
    """Rungs of an accepted effect; none where it holds no special case."""
    effect, dot, axis = name.partition('.')
    if part is None or not EFFECTS[effect].holds or part.selector.rules.prefer_plain:
        return []
    problem = part.selector.problem
    ladder = _Ladder(replace(part, problem=problem), seed)
    regression = part.selector.regression
    whole = part.selection.fit
    theta = whole.thetas[name]
    thetas = {n: t for n, t in whole.thetas.items() if n != name}
    fit = regression.linear(thetas)
    rungs: list[tuple[str, Fit, Fit]] = []
    held = [f'{h}{dot}{axis}' for h in ORDER if h in EFFECTS[effect].holds]
    for plain in [h for h in held if h in problem.terms and h not in thetas]:
        own: Theta = theta[:1] if problem.terms[plain].lower else ()
        thetas[plain] = own
        more = regression.linear(thetas)
        rungs.append((plain, fit, more))
        fit = more
    if not rungs:
        return []
    values = ladder.parameters(fit, [plain for plain, _, _ in rungs])
    out = [ladder.rung(plain, a, b, values[plain]) for plain, a, b in rungs]
    out.append(ladder.rung(name, fit, whole, ladder.parameters(whole, [name])[name]))
    return out + _reversal(ladder, name, whole)


def _reversal(ladder: _Ladder, name: str, whole: Fit) -> list[Rung]:
    """Rungs of the reversal zone: the whole against no pre-sliding, and with Stribeck friction."""
    _, dot, axis = name.partition('.')
    regression, problem = ladder.part.selector.regression, ladder.part.problem
    stribeck = f'{STRIBECK}{dot}{axis}'
    own = ladder.parameters(whole, [name])[name]
    if PRESLIDING not in own or stribeck not in problem.terms:
        return []
    sharp = regression.linear({**whole.thetas, name: (0.0, *whole.thetas[name][1:])})
    out = [ladder.rung(PRESLIDING, sharp, whole, {PRESLIDING: own[PRESLIDING]})]
    falling = None if stribeck in whole.thetas else _falling(ladder, name, stribeck, whole)
    if falling is not None:
        found = ladder.parameters(falling, [stribeck])[stribeck]
        # Its sliding level is the whole effect's: only what falls with the speed is its own.
        found = {key: found[key] for key in ('breakaway', 'stribeck_velocity')}
        out.append(ladder.rung(stribeck, whole, falling, found))
    return out


def _falling(ladder: _Ladder, name: str, stribeck: str, whole: Fit) -> Fit | None:
    """The best fit with a friction that falls with the speed; None where it only rises."""
    regression, problem = ladder.part.selector.regression, ladder.part.problem
    presliding = whole.thetas[name][0]
    best: Fit | None = None
    for width in sorted({theta[1] for theta in problem.terms[stribeck].grid}):
        trial = regression.linear({**whole.thetas, stribeck: (presliding, width)})
        if trial.coefficients[stribeck][1] <= 0.0:
            continue
        if best is None or _fitted(trial, problem) < _fitted(best, problem):
            best = trial
    return best


def _fitted(fit: Fit, problem: Problem) -> float:
    return float(np.mean(fit.residual[problem.fit] ** 2))
