"""What an effect may ask of the rows of a residual.

A signal is a list with one array per session, at every tick; `columns` and `on_axis` make
columns of the regression of them. Implemented by `gap_diagnosis.residuals`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Protocol

from stage_core.arrays import Array

Signal = list[Array]


class ForceRows(Protocol):
    """Force balance of one axis [N]: commanded force less what the nominal motion needs."""

    axis: str
    mass: float  # kg
    viscous: float  # N·s/m
    lead: float  # m
    measured_force: bool  # whether a recorded force is the input: its limits are not known

    @property
    def periods(self) -> list[float]:
        """Tick of each session [s]."""

    def known(self, parameter: str) -> list[float]:
        """Values of a parameter that the twin's own effects of the axis have."""

    def position(self) -> Signal:
        """Path of the axis, free of the encoder's steps [m]."""

    def velocity(self) -> Signal:
        """Central difference of the encoder [m/s]; `columns` takes its noise out."""

    def smooth_velocity(self) -> Signal:
        """Velocity that may stand in a nonlinear function [m/s]."""

    def acceleration(self) -> Signal:
        """Second difference of the encoder [m/s²]; `columns` takes its noise out."""

    def limited_acceleration(self) -> Signal:
        """Acceleration without what is above 90 Hz [m/s²]."""

    def other_velocity(self) -> Signal | None:
        """Velocity of the other one of two axes [m/s]; None where it stands still."""

    def other_acceleration(self) -> Signal | None:
        """Its acceleration without what is above 90 Hz [m/s²]; None where it stands still."""

    def commanded(self) -> Signal:
        """Force as it was commanded [N]."""

    def applied(self, delay: float = 0.0, limit: float = math.inf) -> Signal:
        """Mean force around each tick [N], clipped at a limit [N] and later by a delay [s]."""

    def used(self, signal: Signal) -> Array:
        """A signal (n,) at the rows, as it is."""

    def fitted(self, signal: Signal) -> Array:
        """The same at the rows that fit: where a curve has to be told."""

    def columns(self, *signals: Signal) -> Array:
        """Columns (n, k) of the rows: each signal low-passed as the residual is."""


class Frame(Protocol):
    """Frame and clock of a tracker: measured = R(angle) * table + offset, late by `latency`."""

    angle: float  # rad
    latency: float  # s
    drift: float  # s/s

    def turned(self, points: Array) -> Array:
        """Directions (n, n_axes) in the tracker's frame."""

    def away(self, axes: int) -> Array:
        """Offset (axes,) [m]."""


class TrackerRows(Protocol):
    """Tracker less encoder [m], x rows above y rows.

    Signals have one row per tracker point where nothing else is said.
    """

    axis: str  # the one in question; empty for an effect of the machine as a whole
    axes: tuple[str, ...]
    frames: tuple[Frame, ...]  # taken out of the points before, the inner one first
    rests: bool  # whether a row is a rest, at which no time shows
    both_move: bool  # whether two axes move in one session

    @property
    def lead(self) -> float:
        """Lead of the axis' screw [m]."""

    @property
    def travel(self) -> tuple[float, float]:
        """Middle of the axis' travel and half its length [m]."""

    @property
    def period(self) -> float:
        """Control period [s]."""

    @property
    def step(self) -> float:
        """Step of an ideal encoder of the axis with its noise [m]."""

    def found(self, effect: str) -> Mapping[str, float]:
        """Parameters that the servo link gave to an effect of the axis; empty without it."""

    def encoder(self) -> Signal:
        """Encoder of the axis at every tick [m]."""

    def calm_encoder(self) -> Signal:
        """Encoder of the axis at every tick without what is above 90 Hz [m]."""

    def reading(self) -> Signal:
        """Encoder of the axis at every tick as it was read [m]."""

    def encoder_noise(self) -> Signal:
        """A draw of the noise that `calm_encoder` still has [m]."""

    def misread(self) -> Array:
        """Rows (n,) [m] that this draw makes."""

    def at_points(self, signal: Signal) -> Signal:
        """A signal of every tick at the points, by straight lines."""

    def at_ticks(self, values: Array) -> Signal:
        """Values (m,) of the axis' points of all sessions, shared out to the ticks around each."""

    def smooth_at_points(self, signal: Signal) -> Signal:
        """The same by a cubic spline, for a signal without corners."""

    def points(self) -> Signal:
        """Encoder of all axes (m, n_axes) [m]."""

    def position(self) -> Signal:
        """Encoder of the axis [m]."""

    def position_across(self) -> Signal:
        """Encoder of the other one of two axes [m]."""

    def temperature_rise(self, lag: float = 0.0) -> Signal | None:
        """Screw temperature above the reference [K], of a sensor that is late by `lag` [s].

        None where it is unknown or constant.
        """

    def shifted(self, latency: float = 0.0, drift: float = 0.0) -> Array:
        """Rows (n, 1) [m]: where the table was if the stamps are late or drift, less without."""

    def session_share(self) -> Array:
        """Time of each row (n,) as a share of its session."""

    def along(self, signals: Signal) -> Array:
        """Columns (n, k): signals (m, k) on the rows of the axis, zero on the other's."""

    def across(self, signals: Signal) -> Array:
        """Columns (n, k): signals (m, k) on the rows of the other axis."""

    def rows(self, signals: list[list[Array]]) -> Array:
        """Columns (n, k) of signals[session][axis], each (m, k)."""
