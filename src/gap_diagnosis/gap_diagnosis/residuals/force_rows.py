"""The rows of one axis' force balance: which ticks count, and every signal low-passed there."""

from __future__ import annotations

import math
from collections.abc import Callable
from copy import copy
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.input.data import Record
from gap_diagnosis.input.windows import held_out_windows, inside
from gap_diagnosis.residuals.late_ticks import forces_as_held
from gap_diagnosis.residuals.low_pass import band_limited, smooth
from gap_diagnosis.residuals.nominal import Prediction
from gap_diagnosis.residuals.operators import central_difference, centred_hold, second_difference
from stage_core.arrays import Array
from stage_core.twin_file import TwinFile, nominal_mass

Mask = NDArray[np.bool_]
Rows = TypeVar('Rows', bound='ForceRows')

CORNER = 30.0  # Hz; above it the quantisation of the acceleration is white after the low-pass
#: Hz, of the sharp low-pass beyond it, and the share of noise in the acceleration that is borne.
CUTS, ATTENUATION = (math.inf, 60.0, 45.0, 30.0, 20.0, 14.0, 10.0, 7.0), 1e-3
LONGEST = 120.0  # s of a session that are used; longer ones are thinned in whole blocks
SLIDING = 3.0  # encoder steps within 20 ms, below which the axis counts as resting
#: Least rows in a period of the cut: beyond twice the cut the low-pass lets 0.4 % through.
IN_A_PERIOD = 4.0
#: Least rows of a balance of which some were left out. With 13,751 rows in place of 27,489 a gain
#: of the drive moved by 0.002 of its deviation, which stayed the same to 0.1 %.
ENOUGH = 10_000


class ForceRows:
    """Signals of one axis at the rows of its force balance, sessions concatenated."""

    def __init__(self, records: list[Record], twin: TwinFile, axis: str) -> None:
        self.axis = axis
        self.records = records
        self.nominal = twin.axes[axis]
        self.mass, self.viscous = nominal_mass(self.nominal)
        self.lead = float(getattr(self.nominal, 'lead', 0.010))
        self.stated = float(getattr(self.nominal, 'encoder_resolution', 1e-6))
        self.delay = float(getattr(self.nominal, 'delay', 0.0))
        self.measured_force = twin.kind == 'measured_force'
        self.noise = [r.noise.axes[r.column(axis)] for r in records if r.noise is not None]
        self.cut = math.inf
        self._signals = [self._prepare(r) for r in records]
        self._predictions = [Prediction(r, twin) for r in records] if twin.effects else []
        self.keep = [self._sliding(r, s) for r, s in zip(records, self._signals, strict=True)]
        self.cut = self._quiet_cut()
        self._sliding_ticks, self.keep = self.keep, self._thinned()
        self.simulated = self._of_simulator(twin)

    def _of_simulator(self, twin: TwinFile) -> ForceRows | None:
        """The same rows of a simulator's run of these commands; None without one."""
        runs = [r.simulated for r in self.records if r.simulated is not None]
        if not runs:
            return None
        rows = ForceRows(runs, twin, self.axis)
        rows.keep, rows._sliding_ticks, rows.cut = self.keep, self._sliding_ticks, self.cut
        return rows

    def balance(self) -> Array:
        """Force (n,) [N] that the nominal motion does not need."""
        force, a, v = self.applied(), self.acceleration(), self.velocity()
        rows = self.columns(
            [f - self.mass * ai - self.viscous * vi for f, ai, vi in zip(force, a, v, strict=True)]
        )[:, 0]
        return rows if self.simulated is None else rows - self.simulated.balance()

    def known(self, parameter: str) -> list[float]:
        """Values of a parameter that the twin's own effects of the axis have."""
        own = [
            p.twin.effects[n] for p in self._predictions[:1] for n in p.names('servo', self.axis)
        ]
        return [values[parameter] for values in own if parameter in values]

    @property
    def rest_step(self) -> float:
        """Step [m] of an ideal encoder with the noise of this one at rest."""
        return max((self.stated, *(n.step for n in self.noise)))

    def encoder_noise(self) -> float:
        """Standard deviation [m] of the encoder at the sliding rows."""
        stated = self.stated / math.sqrt(12.0)
        if len(self.noise) < len(self.records):
            return stated
        parts = zip(self.noise, self._of('v_smooth'), self.keep, strict=True)
        measured = [n.std(v[k]) for n, v, k in parts if np.any(k)]
        return max(stated, float(np.sqrt(np.mean(np.square(measured or [0.0])))))

    def _quiet_cut(self) -> float:
        """Frequency [Hz] above which the rows hold more of the encoder's noise than they may.

        Noise in the acceleration is noise in a regressor: it shrinks a mass by its share of the
        regressor's variance (errors in variables), so that this share is what is bounded.
        """
        for cut in CUTS:
            self.cut = cut
            rows = self.columns(self._of('a'))
            # An axis that never slides has none.
            moved = float(np.mean(rows**2)) if rows.size else 0.0
            noise = (self.encoder_noise() * self.response(1.0, 0.0)) ** 2
            if noise < ATTENUATION * max(moved - noise, 0.0):
                break
        return self.cut

    def _thinned(self) -> list[Mask]:
        """Every k-th sliding row where a cut makes the rows between them tell nothing new."""
        count = sum(int(np.count_nonzero(keep)) for keep in self.keep)
        thinned = []
        for record, keep in zip(self.records, self.keep, strict=True):
            step = int(min(1.0 / (IN_A_PERIOD * self.cut * record.period), count / ENOUGH))
            some = np.zeros(len(keep), dtype=bool)
            some[:: max(step, 1)] = True
            thinned.append(keep & some)
        return thinned

    def response(self, mass: float, viscous: float) -> float:
        """Standard deviation of a row of mass · a + viscous · v for noise of 1 m."""
        period = self.records[0].period
        pulse = np.zeros(4001)
        pulse[2000] = 1.0
        force = mass * second_difference(pulse, period)
        force += viscous * central_difference(pulse, period)
        return float(np.linalg.norm(self.passed(force, period)))

    def passed(self, signal: Array, period: float) -> Array:
        """A signal (n,) or (n, k) as a row sees it: low-passed without phase."""
        out = smooth(signal, period, CORNER)
        return out if math.isinf(self.cut) else band_limited(out, period, self.cut)

    def unlimited(self: Rows) -> Rows:
        """The same rows with all the encoder's noise that they hold."""
        other = copy(self)
        other.cut, other.keep = math.inf, self._sliding_ticks
        if self.simulated is not None:
            other.simulated = self.simulated.unlimited()
        return other

    def _prepare(self, record: Record) -> dict[str, Array]:
        i = record.column(self.axis)
        q, period = record.encoder[:, i], record.period
        velocity = central_difference(q, period)
        # The path for friction and ripple: quantisation removed, no overshoot at reversals.
        path = smooth(q, period, 60.0)
        return {
            'q': q,
            'force': forces_as_held(record, i, self.mass, self.viscous),
            'v': velocity,
            'a': second_difference(q, period),
            'a_limited': band_limited(second_difference(q, period), period),
            'p': path,
            'v_smooth': smooth(velocity, period, 60.0),
        }

    def _sliding(self, record: Record, signals: dict[str, Array]) -> NDArray[np.bool_]:
        """Rows at which the axis slides: at rest a force within the friction says nothing."""
        window = max(2, int(round(0.02 / record.period)))
        travel = np.abs(signals['p'][window:] - signals['p'][:-window])
        moving = np.zeros(len(signals['p']), dtype=bool)
        moving[window // 2 : window // 2 + len(travel)] = travel > SLIDING * self.rest_step
        edge = int(round(0.1 / record.period))
        moving[:edge] = False
        moving[-edge:] = False
        moving &= record.whole(record.time)
        if record.duration > LONGEST:
            blocks = (record.time / 10.0).astype(int)
            wanted = np.linspace(0, blocks.max(), int(LONGEST / 10.0)).astype(int)
            moving &= np.isin(blocks, wanted)
        return moving

    def columns(self, *signals: list[Array]) -> Array:
        """Columns (n, k): each per-session signal low-passed, sliding rows only."""
        parts = []
        for record, keep, *own in zip(self.records, self.keep, *signals, strict=True):
            passed = self.passed(np.column_stack(own), record.period)
            parts.append(passed.compress(keep, axis=0))  # faster than passed[keep]
        return parts[0] if len(parts) == 1 else np.concatenate(parts)

    def used(self, signal: list[Array]) -> Array:
        """A per-session signal (n,) at the sliding rows, as it is."""
        return np.concatenate([one[k] for one, k in zip(signal, self.keep, strict=True)])

    def fitted(self, signal: list[Array]) -> Array:
        """The same at the rows that fit; at all of them where none does."""
        fit, _ = self.split()
        used = self.used(signal)
        return used[fit] if fit.any() else used

    def split(self) -> tuple[Mask, Mask]:
        """Rows that fit and rows that are held out, (n,) each."""
        any_held_session = any(r.held_out_session for r in self.records)
        fit, held = [], []
        for record, keep in zip(self.records, self.keep, strict=True):
            mask = inside(record.time, held_out_windows(record))
            fit.append((~mask & (not record.held_out_session))[keep])
            held.append((mask & (record.held_out_session or not any_held_session))[keep])
        return np.concatenate(fit), np.concatenate(held)

    def _of(self, name: str) -> list[Array]:
        return [s[name] for s in self._signals]

    @property
    def periods(self) -> list[float]:
        """Tick of each session [s]."""
        return [r.period for r in self.records]

    def position(self) -> list[Array]:
        """Path for friction and ripple [m]: no encoder steps, no overshoot at reversals."""
        return self._of('p')

    def velocity(self) -> list[Array]:
        """Central difference of the encoder [m/s]."""
        return self._of('v')

    def smooth_velocity(self) -> list[Array]:
        """Velocity that may stand in a nonlinear function [m/s]."""
        return self._of('v_smooth')

    def acceleration(self) -> list[Array]:
        """Second difference of the encoder [m/s²]."""
        return self._of('a')

    def limited_acceleration(self) -> list[Array]:
        """Acceleration without what is above the structure's frequencies [m/s²]."""
        return self._of('a_limited')

    def other_velocity(self) -> list[Array] | None:
        """Velocity of the other one of two axes [m/s]; None where it stands still."""
        return self._of_other(central_difference)

    def other_acceleration(self) -> list[Array] | None:
        """Its acceleration without what is above 90 Hz [m/s²]; None where it stands still."""
        found = self._of_other(second_difference)
        if found is None:
            return None
        return [band_limited(a, r.period) for a, r in zip(found, self.records, strict=True)]

    def _of_other(self, derivative: Callable[[Array, float], Array]) -> list[Array] | None:
        others = [1 - r.column(self.axis) for r in self.records]
        if len(self.records[0].axes) != 2 or not any(
            r.moving[i] for i, r in zip(others, self.records, strict=True)
        ):
            return None
        pairs = zip(others, self.records, strict=True)
        return [derivative(r.encoder[:, i], r.period) for i, r in pairs]

    def commanded(self) -> list[Array]:
        """Force as it was commanded [N]."""
        return self._of('force')

    def applied(self, delay: float = 0.0, limit: float = math.inf) -> list[Array]:
        """Mean force around each tick, clipped and delayed as a drive would do it."""
        return [
            centred_hold(np.clip(s['force'], -limit, limit), (self.delay + delay) / r.period)
            for s, r in zip(self._signals, self.records, strict=True)
        ]
