"""Command -> encoder: the force that the nominal motion does not need, and what may need it.

The recorded force is the plant's input and the encoder its output, so that the equation of
motion can be read backwards (inverse dynamic identification, Gautier 1997; Janot et al. 2019):
residual = F - mass · a - viscous · v, with exact second differences under the zero-order hold
and one zero-phase low-pass on both sides that whitens the encoder's quantisation noise. The
controller needs no model here, and no effect is judged by an open-loop simulation that drifts.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from gap_diagnosis.input.checks import reverses
from gap_diagnosis.residuals.force_rows import ForceRows
from gap_diagnosis.residuals.nominal import re_estimated
from gap_diagnosis.residuals.nuisance import without_nuisances
from gap_diagnosis.residuals.problem import Problem
from stage_core.arrays import Array
from stage_twin import effects
from stage_twin.effects.term import Term

#: Factor within which a mass that no force tells may be another one: so far viscous friction
#: over mass says nothing.
MASS = 2.0
BLOCK = 0.25  # s, length of the blocks that are resampled; the low-pass remembers 0.03 s


class Servo(ForceRows):
    """Problem and terms of the force balance of one axis, sessions concatenated."""

    def problem(self) -> Problem:
        """The regression problem: target in N."""
        target = self.balance()
        there = any(reverses(r, r.column(self.axis)) for r in self.records)
        servo = [
            e.name
            for e in effects.EFFECTS.values()
            if e.link == 'servo' and (there or not e.reverses)
        ]
        candidates = {f'{name}.{self.axis}': self for name in servo}
        terms = effects.terms(candidates)
        stated = 0.0
        if self._predictions:
            nominal = self._nominal(())
            target, stated = target - nominal, float(np.mean(nominal**2))
            terms = re_estimated(
                terms, self._predictions[0].names('servo', self.axis), self._share
            )
        fit, held = self.split()
        block, time, number = [], [], []
        offset = 0
        for session, (record, keep) in enumerate(zip(self.records, self.keep, strict=True)):
            labels = (record.time / BLOCK).astype(np.int64) + offset
            offset = int(labels.max()) + 1
            block.append(labels[keep])
            time.append(record.time[keep])
            number.append(np.full(int(np.count_nonzero(keep)), session))
        problem = Problem(
            target,
            fit,
            held,
            np.concatenate(block),
            np.concatenate(time),
            np.concatenate(number),
            terms,
            self.floor(),
            not any(r.held_out_session for r in self.records),
            signatures=effects.signatures(candidates),
            signal=float(np.var(self.columns(self.applied()))),
            speed=np.abs(self.used(self.smooth_velocity())),
            stated=stated,
        )
        if not all(r.effort_recorded for r in self.records):
            # The integral of the controller that made the force may have started anywhere.
            starts = np.equal.outer(problem.record, np.unique(problem.record))
            problem = without_nuisances(problem, starts.astype(np.float64))
            self._bar_masses(problem.terms)
        return problem

    def _bar_masses(self, terms: dict[str, Term]) -> None:
        """No viscous friction that a machine of another mass would have, too."""
        name = f'viscous_friction.{self.axis}'
        plain = terms[name].admissible
        low, high = (1.0 / MASS - 1.0) * self.viscous, (MASS - 1.0) * self.viscous
        terms[name] = replace(
            terms[name],
            admissible=lambda theta, c: not low < c[0] < high and plain(theta, c),
        )

    def _nominal(self, without: tuple[str, ...]) -> Array:
        """Force rows that the twin's own effects need [N]."""
        return self.columns([p.force(self.axis, without) for p in self._predictions])[:, 0]

    def _share(self, names: tuple[str, ...]) -> Array:
        """Force rows that some of the twin's own effects need beside the others [N]."""
        return self._nominal(()) - self._nominal(names)

    def floor(self) -> float:
        """Standard deviation of the residual that the encoder's noise makes [N]."""
        noise = self.encoder_noise()
        if self.simulated is not None:
            noise = math.hypot(noise, self.simulated.encoder_noise())
        return self.response(self.mass, self.viscous) * noise
