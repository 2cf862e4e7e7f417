"""Encoder -> table -> tracker: the residual of the tracker and the effects that may explain it.

The nominal twin says: the tracker shows what the encoder shows. So the residual is
tracker(t) - encoder(t), x rows above y rows, and every effect of the kinematic and sensor links
adds columns to it. The parametrisation is that of `stage_twin.effects`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from copy import copy

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from gap_diagnosis.input.checks import reverses
from gap_diagnosis.input.data import Record, motion_step
from gap_diagnosis.input.noise import encoder_step
from gap_diagnosis.input.rest_places import rest_places
from gap_diagnosis.input.windows import held_out_windows, inside, moves_while_judged
from gap_diagnosis.residuals.late_ticks import read_in_time
from gap_diagnosis.residuals.low_pass import band_limited, smooth
from gap_diagnosis.residuals.nominal import Prediction, re_estimated
from gap_diagnosis.residuals.operators import Spline, sure_turns
from gap_diagnosis.residuals.problem import Problem
from gap_diagnosis.residuals.stands import stands_of
from stage_core.arrays import Array
from stage_core.twin_file import TwinFile
from stage_twin import effects

BLOCK = 1.0  # s, length of the blocks that are resampled
PATH = 30.0  # Hz, low-pass of a noisy encoder's path; it has no overshoot at reversals
TEMPERATURE_SPAN = 0.3  # K, below it heat and scale cannot be told apart


class Kinematics:
    """Problem and terms of the tracker channels of one or several sessions, rows concatenated."""

    def __init__(
        self, records: list[Record], twin: TwinFile, servo: Mapping[str, Mapping[str, float]]
    ) -> None:
        """`servo`: effects that the servo link was found to have."""
        self.servo = servo
        seen = [r for r in records if r.tracker is not None]
        self._readings = [reading for r in seen for reading in r.encoder.T]
        self.records = [read_in_time(r) for r in seen]
        self.twin = twin
        self.axes = self.records[0].axes
        self.axis = ''  # of the effect in question; empty for the machine as a whole
        first = self.records[0]
        self.frames = tuple(f for f in (first.coarse, first.frame) if f is not None)
        self.rests = any(r.row_noise is not None for r in self.records)
        self.both_move = len(self.axes) == 2 and any(all(r.moving) for r in self.records)
        self._points = [r.encoder_at(_required(r.tracker_time)) for r in self.records]
        # Without noise: what a spline lets through depends on the place between two ticks, and
        # would make some time errors look better than others.
        self._paths = [
            CubicSpline(r.time, band_limited(r.encoder, r.period)) for r in self.records
        ]
        self._splines = [
            Spline.at((_required(r.tracker_time) - r.time[0]) / r.period, len(r.time))
            for r in self.records
        ]

    def rows(self, parts: list[list[Array]]) -> Array:
        """Columns from parts[session][axis], each (m, k): sessions below one another."""
        return np.concatenate([np.concatenate(axes, axis=0) for axes in parts], axis=0)

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
        terms = effects.terms(self._candidates('kinematic', 'sensor'))
        terms.update(effects.table_terms(self._candidates('servo')))
        rows = np.concatenate(target)
        if self.twin.effects:
            own = [Prediction(r, self.twin) for r in self.records]

            def nominal(without: tuple[str, ...]) -> Array:
                return self.rows([list(p.table(without).T) for p in own])

            whole = nominal(())
            rows -= whole
            terms = re_estimated(terms, own[0].seen(), lambda some: whole - nominal(some))
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
            rounding=self._rounding(),
            seams=np.cumsum([0, *(len(t) for t in target[:-1])]),
            before=self._before(),
            stands=None if self.rests else stands_of(self.records, noise),
            places=rest_places(self.records),
            signatures=effects.signatures(self._candidates('kinematic', 'sensor')),
        )

    def _rounding(self) -> float:
        """Mean square [m²] of the encoders' rounding, which follows itself at one speed."""
        if self.twin.kind != 'servo':
            return 0.0
        steps = [encoder_step(reading) for reading in self._readings]
        return float(np.mean(np.square(steps))) / 12.0

    def _before(self) -> dict[str, Array]:
        """Rows of what was taken out of the points: a rotation and offset, a latency, a drift."""
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
            if 'tracker_clock_drift' in moved:
                slow = 1.0 / (1.0 + coarse.drift) - 1.0
                later = record.encoder_at(record.point_time(drift=slow))
                moved['tracker_clock_drift'].append(list((table - later).T))
        return {name: self.rows(parts) for name, parts in moved.items()}

    def row_axis(self) -> NDArray[np.int64]:
        """Column of the axis to which each row of the problem belongs."""
        return np.concatenate(
            [np.repeat(np.arange(len(self.axes)), len(points)) for points in self._points]
        )

    def _candidates(self, *links: str) -> dict[str, Kinematics]:
        """Names of the effects of these links, each with the rows that its axis is asked for."""
        out = {}
        for effect in [e for e in effects.EFFECTS.values() if e.link in links]:
            if not effect.per_axis:
                out[effect.name] = self
            else:
                for i, axis in enumerate(self.axes):
                    if not (self.rests or moves_while_judged(self.records, i)):
                        continue
                    moving = [r for r in self.records if r.moving[i]]
                    if any(not effect.reverses or reverses(r, i) for r in moving):
                        out[f'{effect.name}.{axis}'] = self.of(axis)
        return out

    def of(self, axis: str) -> Kinematics:
        """The same rows, asked for one axis."""
        other = copy(self)
        other.axis = axis
        return other

    @property
    def _column(self) -> int:
        return self.axes.index(self.axis)

    @property
    def lead(self) -> float:
        """Lead of the axis' screw [m]."""
        return float(getattr(self.twin.axes[self.axis], 'lead', 0.010))

    @property
    def travel(self) -> tuple[float, float]:
        """Middle of the axis' travel and half its length [m]."""
        paths = self.encoder()
        low, high = min(float(q.min()) for q in paths), max(float(q.max()) for q in paths)
        return 0.5 * (low + high), max(0.5 * (high - low), 1e-3)

    @property
    def period(self) -> float:
        """Control period [s]."""
        return self.twin.control_period

    @property
    def step(self) -> float:
        """Step of an ideal encoder of the axis with its noise [m]."""
        return motion_step(self.twin, self.axis)

    def found(self, effect: str) -> Mapping[str, float]:
        """Parameters that the servo link gave to an effect of the axis; empty without it."""
        return self.servo.get(f'{effect}.{self.axis}', {})

    def path(self) -> list[Array]:
        """Path of the axis at every tick [m], without noise beyond the encoder's steps."""
        return [self._path(record)[0] for record in self.records]

    def encoder(self) -> list[Array]:
        """The path without what play would take for turns [m]."""
        paths = [self._path(record) for record in self.records]
        return [p if self.rests else sure_turns(p, step) for p, step in paths]

    def _path(self, record: Record) -> tuple[Array, float]:
        """Path and the step of an ideal encoder with as much noise as it has [m]."""
        q, i = record.encoder[:, self._column], self._column
        noise = record.noise.axes[i] if record.noise is not None else None
        if noise is None or not noise.beyond_steps:
            return q, self.step
        # The low-pass lets this share of white noise through.
        left = math.sqrt(0.5 * math.pi * PATH * record.period)
        return smooth(q, record.period, PATH), max(left * self.step, noise.quantum)

    def calm_encoder(self) -> list[Array]:
        """Encoder of the axis at every tick without what is above 90 Hz [m]."""
        return [band_limited(r.encoder[:, self._column], self.period) for r in self.records]

    def reading(self) -> list[Array]:
        """Encoder of the axis at every tick as it was read [m]."""
        return [r.encoder[:, self._column] for r in self.records]

    def encoder_noise(self) -> list[Array]:
        """A draw of the noise of the axis' encoder below 90 Hz [m]; the same at every call."""
        draw, i, out = np.random.default_rng(0), self._column, []
        for record in self.records:
            own = record.noise.axes[i].position if record.noise else self.step / math.sqrt(12.0)
            white = own * draw.standard_normal(len(record.time))
            out.append(band_limited(white, self.period))
        return out

    def misread(self) -> Array:
        """Rows (n,) [m] that this draw makes: the table is where the encoder does not read it."""
        return -self.along(self.smooth_at_points(self.encoder_noise()))[:, 0]

    def at_points(self, signal: list[Array]) -> list[Array]:
        """A signal of every tick at the points, by straight lines."""
        return [
            np.interp(_required(r.tracker_time), r.time, one)
            for r, one in zip(self.records, signal, strict=True)
        ]

    def at_ticks(self, values: Array) -> list[Array]:
        """Values (m,) of the axis' points of all sessions, shared out to the ticks around each.

        The transpose of `at_points`.
        """
        out, at = [], 0
        for record, points in zip(self.records, self._points, strict=True):
            place = (_required(record.tracker_time) - record.time[0]) / record.period
            before = np.clip(place.astype(np.int64), 0, len(record.time) - 2)
            later, own = place - before, values[at : at + len(points)]
            signal = np.zeros(len(record.time))
            np.add.at(signal, before, (1.0 - later) * own)
            np.add.at(signal, before + 1, later * own)
            out.append(signal)
            at += len(points)
        return out

    def smooth_at_points(self, signal: list[Array]) -> list[Array]:
        """The same by a cubic spline, for signals (n, k) without corners."""
        return [spline(one) for spline, one in zip(self._splines, signal, strict=True)]

    def points(self) -> list[Array]:
        """Encoder of all axes (m, a) at the points [m]."""
        return self._points

    def position(self) -> list[Array]:
        """Encoder of the axis at the points [m]."""
        return [p[:, self._column] for p in self._points]

    def position_across(self) -> list[Array]:
        """Encoder of the other one of two axes at the points [m]."""
        return [p[:, 1 - self._column] for p in self._points]

    def temperature_rise(self, lag: float = 0.0) -> list[Array] | None:
        """Screw temperature above the reference at the points [K], the sensor late by `lag` [s].

        None where a session has none, or none that scale and heat could be told apart by.
        """
        reference = self.twin.temperature_reference
        known = [r.temperature[:, self._column] for r in self.records if r.temperature is not None]
        if len(known) < len(self.records):
            return None
        for own in known:
            if max(np.ptp(own), abs(float(own.mean()) - reference)) <= TEMPERATURE_SPAN:
                return None
        return [
            np.interp(_required(r.tracker_time) + lag, r.time, own) - reference
            for r, own in zip(self.records, known, strict=True)
        ]

    def shifted(self, latency: float = 0.0, drift: float = 0.0) -> Array:
        """Rows (n, 1) [m]: where the table was if the stamps are late or drift, less without."""
        ways = []
        for record, path in zip(self.records, self._paths, strict=True):
            own, moved = record.point_time(), record.point_time(latency, drift)
            ends = record.time[0], record.time[-1]
            ways.append(path(np.clip(moved, *ends)) - path(np.clip(own, *ends)))
        return self.rows([[w[:, i : i + 1] for i in range(len(self.axes))] for w in ways])

    def session_share(self) -> Array:
        """Time of each row (n,) as a share of its session."""
        times = [r.point_time() for r in self.records]
        return np.concatenate(
            [np.tile(t / max(float(t[-1]), 1e-9), len(self.axes)) for t in times]
        )

    def along(self, signals: list[Array]) -> Array:
        """Columns (n, k): signals (m, k) per session on the rows of the axis, else zero."""
        return self._on(self._column, signals)

    def across(self, signals: list[Array]) -> Array:
        """Columns (n, k): signals (m, k) per session on the rows of the other axis, else zero."""
        return self._on(1 - self._column, signals)

    def _on(self, i: int, signals: list[Array]) -> Array:
        parts = []
        for signal in signals:
            columns = signal.reshape(len(signal), -1)
            zero = np.zeros_like(columns)
            parts.append([columns if j == i else zero for j in range(len(self.axes))])
        return self.rows(parts)


def _required(values: Array | None) -> Array:
    assert values is not None
    return values
