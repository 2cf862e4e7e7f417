"""The force that nobody recorded: what the drive's own law makes of command and encoder.

The controller reads recorded quantities, so that its force follows from them up to its gains
(docs/reference/interfaces.md, "Servo controller"). The gains are fitted to the motion, beside the
effect that goes with them best: mass · a + viscous · v = force of the law − force of the effect.
Only force over mass shows there; newtons are those for the twin's mass.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from copy import copy
from dataclasses import replace

import numpy as np
from scipy.ndimage import minimum_filter1d
from scipy.optimize import least_squares, minimize_scalar

from gap_diagnosis.input.data import Record
from gap_diagnosis.residuals.control_law import position_loop
from gap_diagnosis.residuals.drive_law import DriveLaw, apart, errors_of, followed, force_of
from gap_diagnosis.residuals.operators import centred_hold
from gap_diagnosis.residuals.problem import Problem
from gap_diagnosis.residuals.servo import MASS, Servo
from gap_diagnosis.residuals.without_forces import NOT_TOLD
from stage_core.arrays import Array
from stage_core.quantities import split_effect
from stage_core.twin_file import ServoAxis, TwinFile

Theta = tuple[float, ...]

#: Effects whose columns hold the force itself: they need its law first.
OF_FORCE = (*NOT_TOLD, 'actuation_delay', 'force_saturation')
#: Of the noise, below which a law by itself explains the motion: laws with gains right to 1.2 %
#: leave 0.7 to 2.1 times the noise, the others 6.2 times and more.
AT_NOISE = 2.5
#: The same for rows that slide, which leave a wrong law more room: 0.7 to 1.02 with right gains,
#: 1.3 and more with wrong ones.
WHILE_SLIDING = 1.2
#: Hz, above which a law is not judged.
CUT = 45.0
#: Hz, above which its gains are not fitted: noise in what is regressed on bends them. Velocity
#: gains are up to 20 % too small at 45 Hz, and right to 1.3 % at 20 Hz but for one (5 %).
CALM = 20.0
#: rad/s of the filter, and s of the delay, from which a fit starts, and their bounds.
CORNERS, CORNER_BOUNDS, DELAYS, LONGEST_DELAY = (300.0, 1200.0), (30.0, 2e4), (2e-4, 3e-3), 0.01
#: Corners [rad/s] of the laws beside which the effects are screened, places of a grid that are
#: tried, and effects that a law is fitted beside in full.
SCREENED, MOST, TRIED = (200.0, 500.0, 1200.0, 5000.0), 12, 3
#: Share by which the position gain may differ from that of the following error, which is off by
#: 1.6 % at most on 64 axes.
FOLLOWED = 0.03
STEP = 0.01  # relative, of the derivatives
#: Of the speed's RMS, that slides, and s around a row in which it has to; least number of rows.
FAST, AROUND, LEAST_ROWS = 0.4, 0.12, 1000
VISCOUS = 'viscous_friction'
#: Shares of the force's peak from which a limit is looked for.
LIMITS = (0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.97, 1.0)


def with_laws(
    records: list[Record], twin: TwinFile
) -> tuple[list[Record], TwinFile, dict[str, DriveLaw]]:
    """Records with the forces of the fitted laws, the twin with their gains, and the laws."""
    laws: dict[str, DriveLaw] = {}
    axes = dict(twin.axes)
    for i, name in enumerate(records[0].axes):
        if not any(r.moving[i] for r in records):
            continue
        fit = _Fit(records, twin, name)
        laws[name] = fit.law()
        if not laws[name].known:
            records = [replace(r, untold=(*r.untold, name)) for r in records]
            continue
        records = [fit.applied(r, laws[name]) for r in records]
        # A limit that was found is an effect; one that nobody stated is beyond what was asked for.
        peak = max(float(np.abs(r.force[:, i]).max()) for r in records)
        limit = max(twin.servo(name).force_limit, 2.0 * peak)
        axes[name] = replace(laws[name].gains, force_limit=limit)
    stated = twin.gains_stated or all(law.known for law in laws.values())
    return records, replace(twin, axes=axes, gains_stated=stated), laws


class _Fit:
    """The law of one axis beside the equation of its motion."""

    def __init__(self, records: list[Record], twin: TwinFile, axis: str, cut: float = CUT) -> None:
        self.axis, self.start, self.twin = axis, twin.servo(axis), twin
        self.i = records[0].column(axis)
        self.records = records
        self.rows = Servo(records, twin, axis)
        self.rows.cut = min(self.rows.cut, cut)
        self.problem: Problem = self.rows.problem()
        self.viscous = self.rows.columns(self.rows.velocity())
        self.heard = all(np.isfinite(r.velocity_command[:, self.i]).all() for r in records)
        fitted = [r for r in records if not r.held_out_session]
        if self.heard:
            self.start = position_loop(fitted, self.i, self.start)[0]
        else:
            self.start = followed(fitted, self.i, self.start)

    def law(self) -> DriveLaw:
        """The law in the first view that it explains to the noise, else in the best one."""
        found: list[DriveLaw] = []
        # An effect and a position gain at once are not told from each other.
        last = (_Fit._beside_an_effect,) if self.heard else ()
        for view in (_Fit._whole, _Fit._sliding, *last):
            found.append(view(self))
            if found[-1].known:
                calm = view(_Fit(self.records, self.twin, self.axis, CALM))
                return self._limited(replace(calm, left=found[-1].left, known=True))
        return min(found, key=lambda law: law.share)

    def _limited(self, law: DriveLaw) -> DriveLaw:
        """The law with the limit of its force, where the motion shows one."""
        free = replace(law.gains, force_limit=math.inf)
        least = AT_NOISE * self.problem.floor
        if self._left(free) < least:
            return replace(law, gains=free)
        peak = max(float(np.abs(force_of(r, self.i, free)).max()) for r in self.records)
        limits = [share * peak for share in LIMITS]
        left = [self._left(replace(free, force_limit=limit)) for limit in limits]
        at = int(np.argmin(left))
        around = limits[max(at - 1, 0)], limits[min(at + 1, len(limits) - 1)]
        best = minimize_scalar(
            lambda limit: self._left(replace(free, force_limit=limit)),
            bounds=around,
            method='bounded',
            options={'xatol': 1e-4 * peak},
        )
        limit = float(best.x) if float(best.fun) < least else math.inf
        return replace(law, gains=replace(free, force_limit=limit))

    def _left(self, gains: ServoAxis) -> float:
        """RMS [N] of what the force of a law leaves of the motion."""
        forces = [force_of(r, self.i, gains) for r in self.records]
        held = [
            centred_hold(f, gains.delay / t)
            for f, t in zip(forces, self.rows.periods, strict=True)
        ]
        rows = (self.problem.target + self.rows.columns(held)[:, 0])[self.problem.fit]
        return float(np.std(rows))

    def _whole(self) -> DriveLaw:
        """All rows, beside viscous friction."""
        starts = [self._theta(corner, late) for corner in CORNERS for late in DELAYS]
        return self._fitted(self.viscous, starts, True)

    def _sliding(self) -> DriveLaw:
        """Rows far from any reversal, where a friction is a constant."""
        speed = self.rows.smooth_velocity()
        size = math.sqrt(float(np.mean(np.concatenate(speed) ** 2)))
        mask = [
            np.maximum(minimum_filter1d(v, n), minimum_filter1d(-v, n)) > FAST * size
            for v, n in zip(speed, (int(AROUND / t) for t in self.rows.periods), strict=True)
        ]
        fit = self.problem.fit & (self.rows.used([m.astype(np.float64) for m in mask]) > 0.5)
        if np.count_nonzero(fit) < LEAST_ROWS:
            return DriveLaw(self.start, math.inf, math.inf, math.inf, False)
        other = copy(self)
        other.problem = replace(self.problem, fit=fit)
        signs = self.rows.columns([np.sign(v) for v in speed])
        law = other._fitted(signs, [self._theta(corner, 0.0) for corner in CORNERS], False, 0.0)
        return replace(law, known=law.left < WHILE_SLIDING * self.problem.floor)

    def _beside_an_effect(self) -> DriveLaw:
        """All rows, beside the effects that go best with some law."""
        starts = [self._theta(CORNERS[-1], 0.0)]
        near = [
            self._fitted(columns, starts, name == VISCOUS) for name, columns in self._candidates()
        ]
        return min(near, key=lambda law: law.left)

    def _fitted(
        self, beside: Array, starts: list[Theta], viscous: bool, latest: float = LONGEST_DELAY
    ) -> DriveLaw:
        theta, left = self._search(beside, starts, latest)
        size = float(np.sqrt(np.mean(self.problem.target[self.problem.fit] ** 2)))
        return self._found(theta, beside, viscous, left, left / size)

    def _theta(self, corner: float, late: float) -> Theta:
        own = () if self.heard else (math.log(self.start.position_gain),)
        return (math.log(corner), self.start.delay + late, *own)

    def gains(self, theta: Theta) -> ServoAxis:
        """Gains with the filter and the position gain of θ."""
        gains = replace(self.start, velocity_filter=math.exp(theta[0]))
        return gains if self.heard else replace(gains, position_gain=math.exp(theta[2]))

    def _columns(self, theta: Theta) -> Array:
        """Rows (n, k) of the velocity's error, of its integral and of the integral's start."""
        gains = self.gains(theta)
        return self._held([errors_of(r, self.i, gains) for r in self.records], theta[1])

    def _loose(self, theta: Theta) -> Array:
        """The same rows (n, k) with the following error and the speed apart, no gain between."""
        return self._held([apart(r, self.i, math.exp(theta[0])) for r in self.records], theta[1])

    def _held(self, parts: list[Array], late: float) -> Array:
        """Rows of per-session signals (n, k) that a drive holds, and of an integral's start."""
        held = [
            [
                centred_hold(p[:, k], late / r.period)
                for p, r in zip(parts, self.records, strict=True)
            ]
            for k in range(parts[0].shape[1])
        ]
        return np.hstack([self.rows.columns(*held), self._starts()])

    def _starts(self) -> Array:
        """Rows (n, r) of where the integral of each session started."""
        found = np.equal.outer(self.problem.record, np.unique(self.problem.record))
        return found.astype(np.float64)

    def _aimed(self, theta: Theta, beside: Array) -> Theta:
        """A start with the position gain that the integral shows.

        Of the two integrals apart, that of the following error goes with position gain times
        integral gain and that of the speed with the integral gain, whatever the filter is.
        """
        if self.heard:
            return theta
        solution, _ = self._regressed(self._loose(theta), beside)
        error, speed = float(solution[2]), float(solution[3])
        own = error / speed if speed > 0.0 else 0.0
        near = abs(own / self.start.position_gain - 1.0) < FOLLOWED
        return (*theta[:2], math.log(own) if near else theta[2])

    def _solved(self, theta: Theta, beside: Array) -> tuple[Array, Array]:
        """Coefficients of the law and of what stands beside it, and what all leave (m,) [N]."""
        return self._regressed(self._columns(theta), beside)

    def _regressed(self, law: Array, beside: Array) -> tuple[Array, Array]:
        fit = self.problem.fit
        matrix = np.hstack([-law, beside])[fit]
        scale = np.linalg.norm(matrix, axis=0) + 1e-300
        solution = np.linalg.lstsq(matrix / scale, self.problem.target[fit], rcond=1e-9)[0]
        return solution / scale, self.problem.target[fit] - matrix / scale @ solution

    def _search(self, beside: Array, starts: list[Theta], latest: float) -> tuple[Theta, float]:
        """The θ of the least remainder, and its RMS [N]."""
        free = () if self.heard else (math.log(self.start.position_gain),)
        low = [math.log(CORNER_BOUNDS[0]), 0.0, *(p - FOLLOWED for p in free)]
        high = [math.log(CORNER_BOUNDS[1]), latest + 1e-7, *(p + FOLLOWED for p in free)]
        found = [
            least_squares(
                lambda z: self._solved(tuple(z), beside)[1],
                np.clip(self._aimed(start, beside), np.array(low) + 1e-8, np.array(high) - 1e-8),
                bounds=(low, high),
                x_scale=[0.1, 1e-4, *(FOLLOWED for _ in free)],
                xtol=1e-8,
                ftol=1e-7,
            )
            for start in starts
        ]
        best = min(found, key=lambda f: float(f.cost))
        return tuple(best.x.tolist()), math.sqrt(2.0 * float(best.cost) / len(best.fun))

    def _candidates(self) -> list[tuple[str, Array]]:
        """The effects that go best with some law, each with its columns."""
        nothing = np.zeros((len(self.problem.target), 0))
        theta, _ = self._search(nothing, [self._theta(CORNERS[-1], DELAYS[0])], LONGEST_DELAY)
        residual = nothing.sum(axis=1)
        residual[self.problem.fit] = self._solved(theta, nothing)[1]
        laws = [self._theta(corner, 0.0) for corner in SCREENED]
        freed = [_freed_of(self._columns(t)[self.problem.fit]) for t in laws]
        target = self.problem.target[self.problem.fit]
        found = []
        for name, term in self.problem.terms.items():
            if split_effect(name)[0] in OF_FORCE:
                continue
            grid = term.propose(residual) if term.propose is not None else term.grid
            best: tuple[float, Array] | None = None
            for own in grid[:: max(1, len(grid) // MOST)]:
                columns = term.columns(own)
                left = min(_remainder(f(columns[self.problem.fit]), f(target)) for f in freed)
                if best is None or left < best[0]:
                    best = left, columns
            if best is not None:
                found.append((best[0], name, best[1]))
        found.sort(key=lambda item: item[0])
        return [(name, columns) for _, name, columns in found[:TRIED]]

    def _found(
        self, theta: Theta, columns: Array, viscous: bool, left: float, share: float
    ) -> DriveLaw:
        coefficients, _ = self._solved(theta, columns)
        gains = replace(
            self.gains(theta),
            velocity_gain=float(coefficients[0]),
            integral_gain=max(float(coefficients[1]), 0.0),
        )
        if viscous:
            extra = float(coefficients[-1]) / max(gains.viscous, 1e-300)
            if 1.0 / MASS - 1.0 < extra < MASS - 1.0:
                gains = replace(gains, viscous=gains.viscous * (1.0 + extra))
        known = left < AT_NOISE * self.problem.floor
        deviation = self._deviation(gains, columns, left)
        return DriveLaw(gains, left, share, deviation, known)

    def _deviation(self, gains: ServoAxis, beside: Array, left: float) -> float:
        """Relative standard deviation of the velocity gain, and so of every force, in a view."""
        parts = [self._tangents(r, gains) for r in self.records]
        held = [
            [
                centred_hold(p[:, k], gains.delay / t)
                for p, t in zip(parts, self.rows.periods, strict=True)
            ]
            for k in range(parts[0].shape[1])
        ]
        others = np.hstack([beside, self._starts()])[self.problem.fit]
        own = _freed_of(others)(self.rows.columns(*held)[self.problem.fit])
        # Rows that a low-pass has made are alike for a while.
        alike = 1.0 / (2.0 * CUT * self.rows.periods[0])
        return left * math.sqrt(alike * float(np.linalg.pinv(own.T @ own)[0, 0]))

    def _tangents(self, record: Record, gains: ServoAxis) -> Array:
        """What the force (n, k) [N] changes by with each of its gains, relative."""
        names = ('velocity_gain', 'integral_gain', 'velocity_filter')
        other = [replace(gains, **{n: getattr(gains, n) * (1.0 + STEP)}) for n in names]
        if not self.heard:
            other.append(replace(gains, position_gain=gains.position_gain * (1.0 + STEP)))
        force = force_of(record, self.i, gains)
        return np.column_stack([(force_of(record, self.i, g) - force) / STEP for g in other])

    def applied(self, record: Record, law: DriveLaw) -> Record:
        """The record with the force of the law."""
        force = record.force.copy()
        force[:, self.i] = force_of(record, self.i, law.gains)
        return replace(record, force=force)


def _freed_of(columns: Array) -> Callable[[Array], Array]:
    """What partials columns (n, k) out of rows (n,) or (n, j)."""
    basis, _ = np.linalg.qr(columns / (np.linalg.norm(columns, axis=0) + 1e-300))
    return lambda rows: np.asarray(rows - basis @ (basis.T @ rows))


def _remainder(columns: Array, target: Array) -> float:
    """RMS of what columns (n, k) leave of a target (n,)."""
    scaled = columns / (np.linalg.norm(columns, axis=0) + 1e-300)
    solution = np.linalg.lstsq(scaled, target, rcond=1e-8)[0]
    return float(np.sqrt(np.mean((target - scaled @ solution) ** 2)))
