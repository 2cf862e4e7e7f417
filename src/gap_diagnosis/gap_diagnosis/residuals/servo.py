"""Command -> encoder: the force that the nominal motion does not need, and what may need it.

The recorded force is the plant's input and the encoder its output, so that the equation of
motion can be read backwards (inverse dynamic identification, Gautier 1997; Janot et al. 2019):
residual = F - mass · a - viscous · v, with exact second differences under the zero-order hold
and one zero-phase low-pass on both sides that whitens the encoder's quantisation noise. The
controller needs no model here, and no effect is judged by an open-loop simulation that drifts.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.input.data import held_out_windows, inside
from gap_diagnosis.residuals.force_rows import ForceRows
from gap_diagnosis.residuals.nominal import re_estimated
from gap_diagnosis.residuals.operators import (
    carried_mass,
    central_difference,
    second_difference,
    smooth,
)
from gap_diagnosis.residuals.regression import Problem, Term, Theta

Array = NDArray[np.float64]

BLOCK = 0.25  # s, length of the blocks that are resampled; the low-pass remembers 0.03 s
PRESLIDING_GRID = (0.0, 1e-6, 3e-6, 8e-6, 15e-6)
FRICTIONS = ('viscous_friction', 'coulomb_friction', 'asymmetric_friction', 'stribeck_friction')
CURVE_KNOTS = (0.0, 3e-3, 1e-2, 3e-2, 1e-1, 3e-1)  # m/s
STRIBECK_GRID = (1e-3, 3e-3, 8e-3, 20e-3, 60e-3)


class Servo(ForceRows):
    """Problem and terms of the force balance of one axis, sessions concatenated."""

    def problem(self) -> Problem:
        """The regression problem: target in N."""
        force, a, v = self.applied(), self._of('a'), self._of('v')
        target = self._columns(
            [f - self.mass * ai - self.viscous * vi for f, ai, vi in zip(force, a, v, strict=True)]
        )[:, 0]
        terms = self.terms()
        if self._predictions:
            target -= self._nominal(())
            terms = re_estimated(
                terms, self._predictions[0].names('servo', self.axis), self._share
            )
        fit, held, block, time, number = [], [], [], [], []
        offset = 0
        any_held_session = any(r.held_out_session for r in self.records)
        for session, (record, keep) in enumerate(zip(self.records, self.keep, strict=True)):
            mask = inside(record.time, held_out_windows(record))
            if any_held_session and not record.held_out_session:
                mask[:] = False
            held.append(mask[keep])
            fit.append((~mask & (not record.held_out_session))[keep])
            labels = (record.time / BLOCK).astype(np.int64) + offset
            offset = int(labels.max()) + 1
            block.append(labels[keep])
            time.append(record.time[keep])
            number.append(np.full(int(np.count_nonzero(keep)), session))
        return Problem(
            target,
            np.concatenate(fit),
            np.concatenate(held),
            np.concatenate(block),
            np.concatenate(time),
            np.concatenate(number),
            terms,
            self.floor(),
            not any_held_session,
            signatures=dict.fromkeys(
                (f'{name}.{self.axis}' for name in FRICTIONS), self._friction_curve
            ),
        )

    def _nominal(self, without: tuple[str, ...]) -> Array:
        """Force rows that the twin's own effects need [N]."""
        return self._columns([p.force(self.axis, without) for p in self._predictions])[:, 0]

    def _share(self, names: tuple[str, ...]) -> Array:
        """Force rows that some of the twin's own effects need beside the others [N]."""
        return self._nominal(()) - self._nominal(names)

    def floor(self) -> float:
        """Standard deviation of the residual that the encoder's quantisation makes [N]."""
        period = self.records[0].period
        pulse = np.zeros(4001)
        pulse[2000] = 1.0
        response = self.mass * second_difference(pulse, period)
        response += self.viscous * central_difference(pulse, period)
        gain = float(np.linalg.norm(smooth(response, period, self.corner)))
        return gain * self.resolution / math.sqrt(12.0)

    def terms(self) -> dict[str, Term]:
        """Every candidate of the servo link for this axis."""
        found = [
            self._inertia(),
            self._viscous(),
            self._coulomb(),
            self._asymmetric(),
            self._stribeck(),
            self._offset(),
            self._ripple(),
            self._cable(),
            self._gain(),
            self._delay(),
            self._resonance(),
        ]
        if not self.measured_force:
            found += self._saturation()
        return {term.name: term for term in found}

    def _inertia(self) -> Term:
        signal = self._columns([self.mass * a for a in self._of('a')])
        return Term(
            f'inertia_mismatch.{self.axis}',
            lambda theta: signal,
            lambda theta, c: {'ratio': float(c[0])},
            admissible=lambda theta, c: -0.8 < c[0] < 3.0,
        )

    def _viscous(self) -> Term:
        signal = self._columns(self._of('v'))
        return Term(
            f'viscous_friction.{self.axis}',
            lambda theta: signal,
            lambda theta, c: {'viscous': float(c[0])},
            # Less than none at all is no friction.
            admissible=lambda theta, c: -self.viscous <= c[0] < 2000.0,
        )

    def _coulomb(self) -> Term:
        return Term(
            f'coulomb_friction.{self.axis}',
            lambda theta: self._columns(self._state(theta[0])),
            lambda theta, c: {'coulomb': float(c[0]), 'presliding': theta[0]},
            grid=tuple((g,) for g in PRESLIDING_GRID),
            lower=(0.0,),
            upper=(20e-6,),
            admissible=lambda theta, c: 0.0 < c[0] < 500.0,
        )

    def _asymmetric(self) -> Term:
        def columns(theta: Theta) -> Array:
            z = self._state(theta[0])
            up = [(v >= 0.0).astype(float) for v in self._of('v_smooth')]
            v = self._of('v')
            return self._columns(
                [zi * ui for zi, ui in zip(z, up, strict=True)],
                [zi * (1.0 - ui) for zi, ui in zip(z, up, strict=True)],
                [vi * ui for vi, ui in zip(v, up, strict=True)],
                [vi * (1.0 - ui) for vi, ui in zip(v, up, strict=True)],
            )

        return Term(
            f'asymmetric_friction.{self.axis}',
            columns,
            lambda theta, c: {
                'coulomb_positive': float(c[0]),
                'coulomb_negative': float(c[1]),
                'viscous_positive': float(c[2]),
                'viscous_negative': float(c[3]),
                'presliding': theta[0],
            },
            grid=tuple((g,) for g in PRESLIDING_GRID),
            lower=(0.0,),
            upper=(20e-6,),
            admissible=lambda theta, c: bool(
                0.0 < c[0] < 500.0
                and 0.0 < c[1] < 500.0
                and min(c[2], c[3]) >= -self.viscous
                and max(c[2], c[3]) < 2000.0
            ),
        )

    def _friction_curve(self) -> Array:
        """Any function of the speed, for each direction: hats over `CURVE_KNOTS`."""
        hats = []
        for sign in (1.0, -1.0):
            for k in range(len(CURVE_KNOTS)):
                height = np.eye(len(CURVE_KNOTS))[k]
                hats.append(
                    [
                        np.where(sign * v > 0.0, np.interp(sign * v, CURVE_KNOTS, height), 0.0)
                        for v in self._of('v_smooth')
                    ]
                )
        return self._columns(*hats)

    def _stribeck(self) -> Term:
        def columns(theta: Theta) -> Array:
            z = self._state(theta[0])
            near = [np.exp(-((v / theta[1]) ** 2)) for v in self._of('v_smooth')]
            return self._columns(z, [zi * n for zi, n in zip(z, near, strict=True)])

        return Term(
            f'stribeck_friction.{self.axis}',
            columns,
            lambda theta, c: {
                'coulomb': float(c[0]),
                'breakaway': float(c[1]),
                'stribeck_velocity': theta[1],
                'presliding': theta[0],
            },
            grid=tuple((g, w) for g in PRESLIDING_GRID for w in STRIBECK_GRID),
            lower=(0.0, 1e-3),
            upper=(20e-6, 0.2),
            admissible=lambda theta, c: bool(0.0 < c[0] < 500.0 and 0.0 < c[1] < 500.0),
        )

    def _offset(self) -> Term:
        signal = self._columns([-np.ones_like(p) for p in self._of('p')])
        return Term(
            f'force_offset.{self.axis}',
            lambda theta: signal,
            lambda theta, c: {'offset': float(c[0])},
            admissible=lambda theta, c: abs(c[0]) < 200.0,
        )

    def _ripple(self) -> Term:
        angles = [2.0 * np.pi * p / self.lead for p in self._of('p')]
        signal = self._columns([-np.sin(a) for a in angles], [-np.cos(a) for a in angles])
        return Term(
            f'force_ripple.{self.axis}',
            lambda theta: signal,
            lambda theta, c: {
                'amplitude': float(np.hypot(c[0], c[1])),
                'phase': float(np.arctan2(c[1], c[0])),
            },
            admissible=lambda theta, c: float(np.hypot(c[0], c[1])) < 100.0,
            nuisances=(0, 1),
            phase=True,
        )

    def _cable(self) -> Term:
        p = self._of('p')
        signal = self._columns(p, [np.ones_like(pi) for pi in p])
        return Term(
            f'cable_force.{self.axis}',
            lambda theta: signal,
            lambda theta, c: {'stiffness': float(c[0]), 'centre': float(-c[1] / c[0])},
            admissible=lambda theta, c: bool(0.0 < c[0] < 2e4 and abs(c[1]) < c[0]),
        )

    def _gain(self) -> Term:
        signal = self._columns([-f for f in self.applied()])
        return Term(
            f'drive_gain.{self.axis}',
            lambda theta: signal,
            lambda theta, c: {'error': float(c[0])},
            admissible=lambda theta, c: -0.8 < c[0] < 1.0,
        )

    def _delay(self) -> Term:
        direct = self.applied()

        def columns(theta: Theta) -> Array:
            late = self.applied(theta[0])
            return self._columns([f - g for f, g in zip(direct, late, strict=True)])

        return Term(
            f'actuation_delay.{self.axis}',
            columns,
            lambda theta, c: {'delay': theta[0]},
            grid=tuple((d,) for d in (2e-4, 5e-4, 1e-3, 1.5e-3, 2e-3, 3e-3, 4e-3, 6e-3, 9e-3)),
            lower=(0.0,),
            upper=(0.02,),
            fixed=True,
        )

    def _resonance(self) -> Term:
        def columns(theta: Theta) -> Array:
            return self._columns(
                [
                    self.mass * carried_mass(s['a_limited'], r.period, theta[0], theta[1])
                    for s, r in zip(self._signals, self.records, strict=True)
                ]
            )

        return Term(
            f'structural_resonance.{self.axis}',
            columns,
            lambda theta, c: {
                'frequency': theta[0],
                'damping': theta[1],
                'mass_ratio': float(c[0]),
            },
            grid=tuple((f, z) for f in (12.0, 18.0, 25.0, 35.0, 50.0, 70.0) for z in (0.02, 0.1)),
            lower=(8.0, 0.0),
            upper=(90.0, 0.3),
            admissible=lambda theta, c: bool(
                0.0 < c[0] < 0.9 and 8.5 < theta[0] < 88.0 and theta[1] < 0.25
            ),
        )

    def _saturation(self) -> list[Term]:
        peak = max(float(np.abs(s['force']).max()) for s in self._signals)
        if peak <= 0.0:
            return []
        direct = self.applied()
        strength = np.abs(
            np.concatenate([s['force'][k] for s, k in zip(self._signals, self.keep, strict=True)])
        )

        def columns(theta: Theta) -> Array:
            clipped = self.applied(limit=theta[0] * peak)
            return self._columns([f - g for f, g in zip(direct, clipped, strict=True)])

        return [
            Term(
                f'force_saturation.{self.axis}',
                columns,
                lambda theta, c: {'limit': theta[0] * peak},
                grid=tuple(
                    (s,) for s in (0.01, 0.02, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9)
                ),
                lower=(0.002,),
                upper=(1.0,),
                fixed=True,
                # With no force at all the equation of motion has the trivial solution 0 = 0.
                admissible=lambda theta, c: float(np.mean(strength > theta[0] * peak)) < 0.5,
            )
        ]
