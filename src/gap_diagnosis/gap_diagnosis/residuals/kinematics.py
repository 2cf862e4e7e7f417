"""Encoder -> table -> tracker: the residual of the tracker and the effects that may explain it.

The nominal twin says: the tracker shows what the encoder shows. So the residual is
tracker(t) - encoder(t), x rows above y rows, and every effect of the kinematic and sensor links
adds columns to it. The parametrisation is that of `stage_twin.effects`.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.input.coarse import Coarse
from gap_diagnosis.input.data import Record, held_out_windows, inside, motion_step
from gap_diagnosis.residuals.nominal import Prediction, re_estimated
from gap_diagnosis.residuals.operators import play
from gap_diagnosis.residuals.regression import Problem, Term, Theta
from stage_core.twin_file import TwinFile

Array = NDArray[np.float64]

BLOCK = 1.0  # s, length of the blocks that are resampled
TEMPERATURE_SPAN = 0.3  # K, below it heat and scale cannot be told apart


class Kinematics:
    """Problem and terms of the tracker channels of one or several sessions, rows concatenated."""

    def __init__(self, records: list[Record], twin: TwinFile) -> None:
        self.records = [r for r in records if r.tracker is not None]
        self.twin = twin
        self.axes = self.records[0].axes
        self.travel = [
            (
                min(float(r.encoder[:, i].min()) for r in self.records),
                max(float(r.encoder[:, i].max()) for r in self.records),
            )
            for i in range(len(self.axes))
        ]
        self._points = [self._at_points(r) for r in self.records]

    @staticmethod
    def _at_points(record: Record) -> Array:
        """Encoder (m, a) [m] at the tracker's points."""
        assert record.tracker_time is not None
        return record.encoder_at(record.tracker_time)

    def _rows(self, parts: list[list[Array]]) -> Array:
        """Columns from parts[session][axis], each (m, k): sessions below one another."""
        return np.concatenate([np.concatenate(axes, axis=0) for axes in parts], axis=0)

    def _on_axis(self, i: int, signals: list[Array]) -> Array:
        """Signals (m, k) per session on the rows of one axis, zero on the other's."""
        parts = []
        for signal in signals:
            columns = signal.reshape(len(signal), -1)
            zero = np.zeros_like(columns)
            parts.append([columns if j == i else zero for j in range(len(self.axes))])
        return self._rows(parts)

    def problem(self) -> Problem:
        """The regression problem over all sessions."""
        target, fit, held, block, time, number = [], [], [], [], [], []
        offset = 0
        any_held_session = any(r.held_out_session for r in self.records)
        for session, (record, points) in enumerate(zip(self.records, self._points, strict=True)):
            assert record.tracker_time is not None and record.tracker is not None
            residual = record.tracker - points
            mask = inside(record.tracker_time, held_out_windows(record))
            if any_held_session and not record.held_out_session:
                mask[:] = False
            labels = (record.tracker_time / BLOCK).astype(np.int64) + offset
            offset = int(labels.max()) + 1
            for i in range(len(self.axes)):
                target.append(residual[:, i])
                held.append(mask)
                fit.append(np.full(len(mask), False) if record.held_out_session else ~mask)
                block.append(labels)
                time.append(record.tracker_time)
                number.append(np.full(len(mask), session))
        terms, rows = self.terms(), np.concatenate(target)
        if self.twin.effects:
            own = [Prediction(r, self.twin) for r in self.records]

            def nominal(without: tuple[str, ...]) -> Array:
                return self._rows([list(p.table(without).T) for p in own])

            whole = nominal(())
            rows -= whole
            names = own[0].names('kinematic')
            terms = re_estimated(terms, names, lambda some: whole - nominal(some))
        tracker = self.twin.tracker
        noise = tracker.noise if tracker is not None else 1.0e-6
        resolution = np.array([motion_step(self.twin, axis) for axis in self.axes])
        floor = math.sqrt(noise**2 + float(np.mean(resolution**2)) / 12.0)
        return Problem(
            rows,
            np.concatenate(fit),
            np.concatenate(held),
            np.concatenate(block),
            np.concatenate(time),
            np.concatenate(number),
            terms,
            floor,
            not any_held_session,
            seams=np.cumsum([0, *(len(t) for t in target[:-1])]),
            before=self._before(),
            signatures=dict.fromkeys(('tracker_latency', 'tracker_clock_drift'), self._lateness),
        )

    def _before(self) -> dict[str, Array]:
        """Rows of what was taken out of the points: by a rotation and offset, by a latency."""
        coarse = self.records[0].coarse
        if coarse is None:
            return {}
        moved: dict[str, list[list[Array]]] = {name: [] for name in coarse.effects}
        for record, table in zip(self.records, self._points, strict=True):
            assert record.tracker is not None
            if 'tracker_misalignment' in moved:
                turn = coarse.turned(record.tracker) - record.tracker
                turn = turn + coarse.away(len(self.axes))
                moved['tracker_misalignment'].append(list(turn.T))
            if 'tracker_latency' in moved:
                # The stamps say that the table was there later, where it was on its way already.
                later = record.encoder_at(record.point_time(latency=-coarse.latency))
                moved['tracker_latency'].append(list((table - later).T))
        return {name: self._rows(parts) for name, parts in moved.items()}

    def row_axis(self) -> NDArray[np.int64]:
        """Column of the axis to which each row of the problem belongs."""
        return np.concatenate(
            [np.repeat(np.arange(len(self.axes)), len(points)) for points in self._points]
        )

    def terms(self) -> dict[str, Term]:
        """Every candidate that these sessions can show."""
        terms: list[Term] = []
        for i, axis in enumerate(self.axes):
            if not any(r.moving[i] for r in self.records):
                continue
            terms += [self._scale(i, axis), self._cyclic(i, axis), self._backlash(i, axis)]
            if self._temperature_known(i):
                terms.append(self._thermal(i, axis))
            if len(self.axes) == 2:
                terms += [self._straightness(i, axis), self._angular(i, axis)]
        if len(self.axes) == 2 and any(all(r.moving) for r in self.records):
            terms.append(self._nonorthogonality())
        terms.append(self._misalignment())
        # The clock of a tracker shows in motion alone.
        if not any(r.points_per_row > 1.0 for r in self.records):
            terms += [self._latency(), self._drift()]
        return {term.name: term for term in terms}

    def _scale(self, i: int, axis: str) -> Term:
        signal = self._on_axis(i, [p[:, i] for p in self._points])
        return Term(
            f'scale_error.{axis}',
            lambda theta: signal,
            lambda theta, c: {'error': float(c[0])},
            admissible=lambda theta, c: abs(c[0]) < 0.01,
        )

    def _cyclic(self, i: int, axis: str) -> Term:
        lead = float(getattr(self.twin.axes[axis], 'lead', 0.010))
        angles = [2.0 * np.pi * p[:, i] / lead for p in self._points]
        signal = self._on_axis(i, [np.column_stack([np.sin(a), np.cos(a)]) for a in angles])
        return Term(
            f'cyclic_pitch_error.{axis}',
            lambda theta: signal,
            lambda theta, c: {
                'amplitude': float(np.hypot(c[0], c[1])),
                'phase': float(np.arctan2(c[1], c[0])),
            },
            admissible=lambda theta, c: float(np.hypot(c[0], c[1])) < 200e-6,
            nuisances=(0, 1),
            phase=True,
        )

    def _backlash(self, i: int, axis: str) -> Term:
        def columns(theta: Theta) -> Array:
            parts = []
            for record in self.records:
                assert record.tracker_time is not None
                slack = play(record.encoder[:, i], theta[0])
                parts.append(np.interp(record.tracker_time, record.time, slack))
            return self._on_axis(i, parts)

        return Term(
            f'backlash.{axis}',
            columns,
            lambda theta, c: {'width': theta[0]},
            grid=tuple((w,) for w in np.geomspace(0.5e-6, 300e-6, 22)),
            lower=(0.0,),
            upper=(1.0e-3,),
            fixed=True,
        )

    def _temperature_known(self, i: int) -> bool:
        known = [r.temperature for r in self.records]
        return all(
            t is not None
            and (
                np.ptp(t[:, i]) > TEMPERATURE_SPAN
                or abs(float(t[:, i].mean()) - self.twin.temperature_reference) > TEMPERATURE_SPAN
            )
            for t in known
        )

    def _thermal(self, i: int, axis: str) -> Term:
        parts = []
        for record, points in zip(self.records, self._points, strict=True):
            assert record.temperature is not None and record.tracker_time is not None
            rise = np.interp(record.tracker_time, record.time, record.temperature[:, i])
            rise = rise - self.twin.temperature_reference
            parts.append(np.column_stack([rise * points[:, i], -rise]))
        signal = self._on_axis(i, parts)
        return Term(
            f'thermal_expansion.{axis}',
            lambda theta: signal,
            lambda theta, c: {'coefficient': float(c[0]), 'fixed_point': float(c[1] / c[0])},
            # Screws grow with heat; a shrinking one is a drift of another kind.
            admissible=lambda theta, c: 0.0 < c[0] < 50e-6 and abs(c[1]) < 2.0 * abs(c[0]),
        )

    def _shape(self, i: int) -> tuple[float, float]:
        low, high = self.travel[i]
        return 0.5 * (low + high), max(0.5 * (high - low), 1e-3)

    def _straightness(self, i: int, axis: str) -> Term:
        centre, half = self._shape(i)
        parts = []
        for points in self._points:
            s = (points[:, i] - centre) / half
            parts.append(np.column_stack([1.5 * s**2 - 0.5, 2.5 * s**3 - 1.5 * s]))
        signal = self._on_axis(1 - i, parts)
        return Term(
            f'straightness.{axis}',
            lambda theta: signal,
            lambda theta, c: {
                'quadratic': float(c[0]),
                'cubic': float(c[1]),
                'centre': centre,
                'half_range': half,
            },
            admissible=lambda theta, c: float(np.max(np.abs(c))) < 1e-3,
        )

    def _angular(self, i: int, axis: str) -> Term:
        centre, half = self._shape(i)
        sign = -1.0 if i == 0 else 1.0
        parts = []
        for points in self._points:
            s = (points[:, i] - centre) / half
            parts.append(sign * np.column_stack([s * points[:, 1 - i], s]))
        signal = self._on_axis(i, parts)
        return Term(
            f'angular_error.{axis}',
            lambda theta: signal,
            lambda theta, c: {
                'linear': float(c[0]),
                'quadratic': 0.0,
                'arm': float(c[1] / c[0]),
                'centre': centre,
                'half_range': half,
            },
            admissible=lambda theta, c: abs(c[0]) < 5e-3 and abs(c[1]) < abs(c[0]),
        )

    def _nonorthogonality(self) -> Term:
        signal = self._rows([[-p[:, 1:2], np.zeros((len(p), 1))] for p in self._points])
        return Term(
            'nonorthogonality',
            lambda theta: signal,
            lambda theta, c: {'angle': float(np.arcsin(np.clip(c[0], -0.05, 0.05)))},
            admissible=lambda theta, c: abs(c[0]) < 0.05,
        )

    def _misalignment(self) -> Term:
        coarse, frame = self.records[0].coarse or Coarse(), self.records[0].frame or Coarse()
        if len(self.axes) == 1:
            key = f'offset_{self.axes[0]}'
            away = float(coarse.away(1)[0] + frame.away(1)[0])
            signal = self._rows([[np.ones((len(p), 1))] for p in self._points])
            return Term(
                'tracker_misalignment',
                lambda theta: signal,
                lambda theta, c: {'angle': 0.0, key: away + float(c[0])},
                nuisances=(0,),
            )
        parts = []
        for p in self._points:
            one, zero = np.ones(len(p)), np.zeros(len(p))
            parts.append(
                [np.column_stack([-p[:, 1], one, zero]), np.column_stack([p[:, 0], zero, one])]
            )
        signal = self._rows(parts)

        def parameters(theta: Theta, c: Array) -> dict[str, float]:
            away = coarse.turned(c[None, 1:]) + coarse.away(2)
            away = (frame.turned(away) + frame.away(2))[0]
            return {
                'angle': frame.angle + coarse.angle + float(np.arcsin(np.clip(c[0], -1.0, 1.0))),
                'offset_x': float(away[0]),
                'offset_y': float(away[1]),
            }

        return Term(
            'tracker_misalignment',
            lambda theta: signal,
            parameters,
            nuisances=(1, 2),
        )

    def _shifted(self, true_time: list[Array]) -> Array:
        moved = [r.encoder_at(t) for r, t in zip(self.records, true_time, strict=True)]
        return self._rows(
            [
                [(m - p)[:, i : i + 1] for i in range(len(self.axes))]
                for m, p in zip(moved, self._points, strict=True)
            ]
        )

    def _latency(self) -> Term:
        def columns(theta: Theta) -> Array:
            return self._shifted([r.point_time(latency=theta[0]) for r in self.records])

        coarse, frame = self.records[0].coarse or Coarse(), self.records[0].frame or Coarse()
        known = coarse.latency + frame.latency
        grid = [s * v for v in np.geomspace(1e-4, 0.05, 12) for s in (1.0, -1.0)]
        return Term(
            'tracker_latency',
            columns,
            lambda theta, c: {'latency': known + theta[0]},
            grid=tuple((v,) for v in grid),
            lower=(-0.1,),
            upper=(0.1,),
            fixed=True,
            noisy=True,
        )

    def _lateness(self) -> Array:
        """A time error that changes with time in any smooth way: columns velocity · tᵏ."""
        step = 0.5e-3
        velocity = self._shifted([r.point_time(latency=-step) for r in self.records])[:, 0] / step
        times = [r.point_time() for r in self.records]
        parts = [np.tile(t / max(float(t[-1]), 1e-9), len(self.axes)) for t in times]
        share = np.concatenate(parts)
        return np.column_stack([velocity * share**k for k in range(3)])

    def _drift(self) -> Term:
        def columns(theta: Theta) -> Array:
            return self._shifted([r.point_time(drift=theta[0]) for r in self.records])

        known = (self.records[0].frame or Coarse()).drift
        grid = [s * v for v in np.geomspace(2e-6, 1e-3, 12) for s in (1.0, -1.0)]
        return Term(
            'tracker_clock_drift',
            columns,
            lambda theta, c: {'drift': known + theta[0]},
            grid=tuple((v,) for v in grid),
            lower=(-1e-3,),
            upper=(1e-3,),
            fixed=True,
            noisy=True,
        )
