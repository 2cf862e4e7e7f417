"""Which effects: forward selection on held-out gain, and leave-one-out.

A set grows by the effect whose joint fit gains most on rows that no fit has seen. An effect
stays only while taking it out costs significantly (block bootstrap), while its parameters are
physical, and while what it gains matters beside the noise and the gap.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from gap_diagnosis.residuals.problem import Problem
from gap_diagnosis.residuals.regression import Fit, Regression
from gap_diagnosis.selection.gains import block_gains, block_rms_gains, bootstrap_interval
from gap_diagnosis.selection.grow import grow, grow_anew
from gap_diagnosis.selection.model import Evidence, Passed, Rules, Selection, Trial
from gap_diagnosis.selection.pairs import pair
from gap_diagnosis.selection.possible import refined, too_few_places
from gap_diagnosis.selection.simpler import merge, plain
from gap_diagnosis.selection.trials import best_shape
from stage_core.arrays import Array
from stage_twin.effects import EFFECTS, effect_of

#: Among effects that gain about the same, the one with fewer parameters is taken.
ABOUT_THE_SAME = 0.98
#: Share of what a set leaves above the noise that an effect explains where it is what was lacking,
#: however small it is beside the gap. On 70 development sessions a right one explained 0.70, the
#: wrong ones, which take up the errors of other models, 0.44 at most. What finds its periods in
#: the residual (`Term.propose`) explains any: a ripple took up the rest of a smooth force. Beside
#: an unknown mechanism two wrong resonances explained 0.35 and 0.39 of what the tracker showed.
LACKING = 0.6


class Selector:
    """Selects effects for one problem; deterministic for a seed."""

    def __init__(
        self, problem: Problem, rules: Rules, seed: int, raw: Array | None = None
    ) -> None:
        self.problem = problem
        self.rules = rules
        self.seed = seed
        self.regression = Regression(problem)
        self.noise = problem.floor**2
        self.raw = raw if raw is not None else problem.target
        self.gap = max(problem.mean_square(problem.judged) - self.noise, 0.0)
        #: Each effect in the shape that all others grow from.
        self.plainest = dict(problem.terms)
        #: Effects that another one was taken before.
        self.passed: dict[str, Passed] = {}

    def select(self, first: Sequence[str] = ()) -> Selection:
        """Run forward selection and pruning; rivals are left to `rivals.find_rivals`.

        `first` are accepted before all others are tried; they too are left out if they can be.
        """
        accepted = [name for name in self.rules.given if name in self.problem.terms]
        base = self.regression.linear({n: self.problem.terms[n].grid[0] for n in accepted})
        for name in self.rules.kept:
            if name not in accepted:
                accepted, base = [*accepted, name], self.with_effect(base, name)
        for name in first:
            fit = self.regression.linear(self._trial(base, name, accepted).thetas)
            accepted, base = self._grown(accepted, fit, name)
        rejected: dict[str, Evidence] = {}
        while len(accepted) < self.rules.largest:
            trials = self.trials(base, accepted)
            if not rejected:
                rejected = {name: trial.evidence for name, trial in trials.items()}
            good = [
                (trial.evidence.gain, name)
                for name, trial in trials.items()
                if self.counts(trial.evidence, base)
            ]
            if not good:
                rejected.update({n: t.evidence for n, t in trials.items()})
                if accepted or (found := pair(self, base, trials)) is None:
                    break
                accepted, base = found
                continue
            was = accepted, good
            while good:
                name = self._simplest(good, trials)
                good = [(gain, other) for gain, other in good if other != name]
                joint = refined(self, trials[name].thetas, list(trials[name].thetas))
                # A set in which one effect takes an impossible value explains nothing.
                if all(self.admissible(joint, n) for n in joint.thetas):
                    if not first:
                        self._note_passed(*was, name, trials)
                    accepted, base = self._grown(accepted, joint, name)
                    if effect_of(name).exact:
                        # What they explain is no measure for the errors of other models.
                        rest = joint.mean_square(self.problem) - self.noise
                        self.gap = min(self.gap, max(rest, 0.0))
                    break
            else:
                rejected.update({n: t.evidence for n, t in trials.items()})
                break
        base = grow_anew(self, base, accepted)
        accepted, base = merge(self, accepted, base)
        accepted, base, evidence = self.prune(accepted, base)
        simpler, plainer = plain(self, accepted, base)
        if simpler != accepted:
            accepted, base, evidence = self.prune(simpler, plainer)
        for name in accepted:
            rejected.pop(name, None)
        return Selection(accepted, base, evidence, rejected)

    def _grown(self, accepted: list[str], fit: Fit, name: str) -> tuple[list[str], Fit]:
        """The set with one more effect in as rich a shape as data bear, without what it holds."""
        accepted, fit = self._simplify([*accepted, name], fit)
        return accepted, grow(self, fit, [name])

    def _note_passed(
        self,
        accepted: list[str],
        good: list[tuple[float, str]],
        taken: str,
        trials: dict[str, Trial],
    ) -> None:
        """Effects that another one is taken before, without those that no machine has at θ."""
        most = max(good)[0]
        for gain, name in good:
            known = self.passed.get(name)
            if trials[name].odd:
                continue
            if name != taken and (known is None or gain / most > known.share):
                plainer = self.size(name) < self.size(taken)
                self.passed[name] = Passed(gain / most, accepted, plainer)

    def with_given(self, selection: Selection, given: dict[str, Evidence]) -> Selection:
        """A selection on whitened rows, joined with effects that unwhitened rows established.

        An effect stays only if it also explains something of the rows as they were measured.
        """
        plain = self.as_measured()
        names = list(given) + [n for n in selection.accepted if n not in given]
        thetas = {
            n: selection.fit.thetas.get(n) or self.regression.warm_start(selection.fit, n)
            for n in names
        }
        fit = plain.linear({})
        while thetas:
            fit = plain.refine(thetas, list(thetas), rounds=8)
            rows = plain.problem.judged
            worse = [
                n
                for n in thetas
                if n not in given
                and n not in self.rules.kept
                and np.mean(fit.crossed[rows] ** 2)
                > np.mean(
                    plain.linear({m: t for m, t in thetas.items() if m != n}).crossed[rows] ** 2
                )
            ]
            if not worse:
                break
            thetas.pop(worse[0])
        if not given:
            kept = {n: t for n, t in selection.fit.thetas.items() if n in thetas}
            fit = self.regression.linear(kept)
        evidence = {n: given.get(n) or selection.evidence[n] for n in thetas}
        return Selection(list(thetas), fit, evidence, selection.rejected)

    def as_measured(self) -> Regression:
        """The same rows without the whitening of a slow remainder, which weighs fast motion."""
        return Regression(replace(self.problem, whitening=0.0, target=self.raw))

    def trials(self, base: Fit, accepted: list[str]) -> dict[str, Trial]:
        """Each other effect beside a set."""
        return {
            name: self._trial(base, name, accepted)
            for name in self.problem.terms
            if name not in accepted and not self.barred(name, accepted)
        }

    def _trial(self, base: Fit, name: str, accepted: list[str]) -> Trial:
        """An effect beside a set, tried once for all passes."""
        key = (
            *('trial', self.problem.terms[name], tuple(accepted), tuple(base.thetas.items())),
            *(float(base.residual @ base.residual), self.gap, self.rules, self.problem.whitening),
        )
        found = self.problem.tried.once(key, lambda: best_shape(self, base, name, accepted))
        self.problem.terms[name] = found.shape
        return found._replace(evidence=replace(found.evidence, alternatives=[]))

    def _simplest(self, good: list[tuple[float, str]], trials: dict[str, Trial]) -> str:
        """Of the effects that gain about as much as the best one, that with fewest parameters.

        One that no machine has at its θ comes last.
        """
        most = max(good)[0]

        near = [
            (trials[name].odd, self.size(name), -gain, name)
            for gain, name in good
            if gain >= ABOUT_THE_SAME * most
        ]
        return min(near)[-1]

    def size(self, name: str) -> int:
        """Number of free parameters of an effect in its present shape."""
        term = self.problem.terms[name]
        linear = 0 if term.fixed else self.regression.columns(name, term.grid[0]).shape[1]
        return linear + len(term.lower)

    def without(self, base: Fit, names: Collection[str]) -> Fit:
        """The set less some effects, all others at their nonlinear parameters."""
        left = {n: t for n, t in base.thetas.items() if n not in names}
        return self.regression.linear(left) if names else base

    def with_effect(self, base: Fit, name: str) -> Fit:
        """The set with one more effect: its θ refined, and that of what was taken out before."""
        theta = self.regression.warm_start(base, name)
        free = [n for n in self.rules.kept if n in base.thetas and n != name]
        return refined(self, {**base.thetas, name: theta}, [name, *free], rounds=8)

    def barred(self, name: str, accepted: list[str]) -> bool:
        """Whether an accepted effect holds this one as a special case or excludes it."""
        effect, _, axis = name.partition('.')
        others = [a.partition('.')[0] for a in accepted if a.partition('.')[2] == axis]
        excluded = any(effect in EFFECTS[other].excludes for other in others)
        return excluded or self.contained(name, accepted)

    def contained(self, name: str, accepted: list[str]) -> bool:
        """Whether an accepted effect holds this one as a special case."""
        effect, _, axis = name.partition('.')
        return any(effect in self._held(a) for a in accepted if a.partition('.')[2] == axis)

    def _held(self, name: str) -> tuple[str, ...]:
        """Effects that this one, in its present shape, holds as special cases."""
        return EFFECTS[name.partition('.')[0]].holds if self.problem.terms[name].holds else ()

    def replaced(self, name: str, accepted: list[str]) -> tuple[str, ...]:
        """Accepted effects that this one, in its present shape, holds as special cases."""
        axis, held = name.partition('.')[2], self._held(name)
        return tuple(
            a for a in accepted if a.partition('.')[0] in held and a.partition('.')[2] == axis
        )

    def admissible(self, fit: Fit, name: str) -> bool:
        """Whether an effect's parameters are physical in a fit, and such as a twin takes."""
        term, theta, linear = self.problem.terms[name], fit.thetas[name], fit.coefficients[name]
        if not term.admissible(theta, linear) or too_few_places(self, fit, name):
            return False
        found = term.parameters(theta, linear)
        return all(
            p.minimum <= found.get(p.name, p.minimum) <= p.maximum
            for p in effect_of(name).parameters
        )

    def evidence(self, name: str, base: Fit, fit: Fit) -> Evidence:
        """What a set with one more effect gains on held-out rows."""
        gain = float(block_gains(self.problem, base, fit).mean())
        rest = max(base.mean_square(self.problem) - self.noise, 0.1 * self.noise)
        gains = block_rms_gains(self.problem, base, fit)
        return Evidence(
            name,
            gain,
            bootstrap_interval(gains, self.seed, level=self.rules.level),
            min(gain / rest, 1.0),
            self.admissible(fit, name),
        )

    def counts(self, evidence: Evidence, base: Fit) -> bool:
        """Whether a possible effect gains for certain, and enough beside noise and gap."""
        rest = max(base.mean_square(self.problem) - self.noise, 0.0)
        least = max(self.least(evidence.name, evidence.gain, rest), self.rules.of_rest * rest)
        return evidence.admissible and evidence.interval[0] > 0.0 and evidence.gain > least

    def least(self, name: str, gain: float = 0.0, rest: float = 0.0) -> float:
        """Least mean-square gain of an effect; that of the noise where it is most of a rest."""
        rules = self.rules
        signal = rules.of_signal * self.problem.terms[name].follows * self.problem.signal
        least = max(rules.of_gap * self.gap, rules.of_noise * self.noise, signal, 1e-300)
        term = self.problem.terms[name]
        lacking = term.propose is None and gain > LACKING * rest > LACKING * self.noise
        least = min(least, self.noise) if lacking else least
        # What the twin states of an effect is right up to the error of its model.
        return least if term.base is None else max(least, rules.of_gap * self.problem.stated)

    def _simplify(self, accepted: list[str], base: Fit) -> tuple[list[str], Fit]:
        """Drop plain effects that a later, richer one holds as special cases."""
        for name in list(accepted):
            held = self.replaced(name, [a for a in accepted if a != name])
            if held:
                accepted = [a for a in accepted if a not in held]
        if len(accepted) < len(base.thetas):
            base = self.regression.refine(
                {n: t for n, t in base.thetas.items() if n in accepted}, accepted
            )
        return accepted, base

    def without_effect(self, fit: Fit, name: str) -> Fit:
        """The set with one effect less, all others refined where that leaves a machine.

        Another one that takes its place at parameters that no machine has keeps its own instead.
        """
        kept = {n: t for n, t in fit.thetas.items() if n != name}
        less = self.regression.refine(kept, list(kept), rounds=6)
        possible = all(self.admissible(less, n) for n in kept)
        return less if possible else self.regression.linear(kept)

    def prune(self, accepted: list[str], fit: Fit) -> tuple[list[str], Fit, dict[str, Evidence]]:
        """Leave one out, the weakest first, until each one counts."""
        while accepted:
            less = {n: self.without_effect(fit, n) for n in accepted}
            evidence = {n: self.evidence(n, less[n], fit) for n in accepted}
            for name in accepted:
                evidence[name].admissible = self.admissible(fit, name)
            weak = [
                (evidence[n].gain, n)
                for n in accepted
                if n not in self.rules.kept and not self.counts(evidence[n], less[n])
            ]
            if not weak:
                return accepted, fit, evidence
            _, worst = min(weak)
            accepted = [a for a in accepted if a != worst]
            fit = less[worst]
        return accepted, fit, {}
