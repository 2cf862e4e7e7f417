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

from gap_diagnosis.data import Record, held_out_windows, inside, nominal_mass
from gap_diagnosis.nominal import Prediction, re_estimated
from gap_diagnosis.operators import (
    band_limited,
    carried_mass,
    central_difference,
    centred_hold,
    presliding_state,
    second_difference,
    smooth,
)
from gap_diagnosis.regression import Problem, Term, Theta
from stage_core.twin_file import TwinFile

Array = NDArray[np.float64]

BLOCK = 0.25  # s, length of the blocks that are resampled; the low-pass remembers 0.03 s
CORNER = 30.0  # Hz; above it the quantisation of the acceleration is white after the low-pass
LONGEST = 120.0  # s of a session that are used; longer ones are thinned in whole blocks
SLIDING = 3.0  # encoder steps within 20 ms, below which the axis counts as resting
PRESLIDING_GRID = (0.0, 1e-6, 3e-6, 8e-6, 15e-6)
FRICTIONS = ('viscous_friction', 'coulomb_friction', 'asymmetric_friction', 'stribeck_friction')
CURVE_KNOTS = (0.0, 3e-3, 1e-2, 3e-2, 1e-1, 3e-1)  # m/s
STRIBECK_GRID = (1e-3, 3e-3, 8e-3, 20e-3, 60e-3)


class Servo:
    """Problem and terms of the force balance of one axis, sessions concatenated."""

    def __init__(self, records: list[Record], twin: TwinFile, axis: str) -> None:
        self.axis = axis
        self.records = records
        self.nominal = twin.axes[axis]
        self.mass, self.viscous = nominal_mass(self.nominal)
        self.lead = float(getattr(self.nominal, 'lead', 0.010))
        self.resolution = float(getattr(self.nominal, 'encoder_resolution', 1e-6))
        self.delay = float(getattr(self.nominal, 'delay', 0.0))
        self.measured_force = twin.kind == 'measured_force'
        self.corner = CORNER
        self._signals = [self._prepare(r) for r in records]
        self._predictions = [Prediction(r, twin) for r in records] if twin.effects else []
        keep = [self._used(r, s) for r, s in zip(records, self._signals, strict=True)]
        self.keep = keep
        self.position = np.concatenate(
            [s['p'][k] for s, k in zip(self._signals, keep, strict=True)]
        )

    def _prepare(self, record: Record) -> dict[str, Array]:
        i = record.column(self.axis)
        q, force, period = record.encoder[:, i], record.force[:, i], record.period
        velocity = central_difference(q, period)
        # The path for friction and ripple: quantisation removed, no overshoot at reversals.
        path = smooth(q, period, 60.0)
        return {
            'q': q,
            'force': force,
            'v': velocity,
            'a': second_difference(q, period),
            'a_limited': band_limited(second_difference(q, period), period),
            'p': path,
            'v_smooth': smooth(velocity, period, 60.0),
        }

    def _used(self, record: Record, signals: dict[str, Array]) -> NDArray[np.bool_]:
        """Rows at which the axis slides: at rest a force within the friction says nothing."""
        window = max(2, int(round(0.02 / record.period)))
        travel = np.abs(signals['p'][window:] - signals['p'][:-window])
        moving = np.zeros(len(signals['p']), dtype=bool)
        moving[window // 2 : window // 2 + len(travel)] = travel > SLIDING * self.resolution
        edge = int(round(0.1 / record.period))
        moving[:edge] = False
        moving[-edge:] = False
        moving &= record.whole(record.time)
        if record.duration > LONGEST:
            blocks = (record.time / 10.0).astype(int)
            wanted = np.linspace(0, blocks.max(), int(LONGEST / 10.0)).astype(int)
            moving &= np.isin(blocks, wanted)
        return moving

    def _columns(self, *parts: list[Array]) -> Array:
        """Columns: one list of per-session signals each, low-passed, sliding rows only."""
        columns = []
        for part in parts:
            rows = [
                smooth(signal, record.period, self.corner)[keep]
                for signal, record, keep in zip(part, self.records, self.keep, strict=True)
            ]
            columns.append(np.concatenate(rows))
        return np.column_stack(columns)

    def _of(self, name: str) -> list[Array]:
        return [s[name] for s in self._signals]

    def applied(self, delay: float = 0.0, limit: float = math.inf) -> list[Array]:
        """Mean force around each tick, clipped and delayed as a drive would do it."""
        return [
            centred_hold(np.clip(s['force'], -limit, limit), (self.delay + delay) / r.period)
            for s, r in zip(self._signals, self.records, strict=True)
        ]

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

    def _state(self, presliding: float) -> list[Array]:
        return [presliding_state(p, presliding) for p in self._of('p')]

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
