"""What the instruments make of a simulated motion: tracker, temperatures, recorded effort."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from ..machine import Machine
from ..record import Planted

Array = np.ndarray
# The table's displacements see this many points per tick, so that a play's edge is not lost.
FINE = 8
# The tracker starts after the longest latency [s].
FIRST_POINT = 0.03
SENSOR_NOISE = 0.02


def collected(planted: list[Planted], key: str) -> list[Any]:
    """The settings of that name of all that is planted."""
    return [p.settings[key] for p in planted if key in p.settings]


def _seen(planted: list[Planted], key: str, letter: str) -> bool:
    return any(choice.get(letter, False) for choice in collected(planted, key))


def warmth(rng: np.random.Generator, planted: list[Planted], seconds: float) -> Any:
    """Function of time: both screws' temperatures above the reference (n, 2) [K].

    Screws without expansion warm up, too: a temperature that moves is no evidence by itself.
    """
    start, rise = rng.normal(0.0, 0.5, 2), rng.choice([0.0, 0.5, 3.0]) * rng.uniform(0.2, 1.0, 2)
    own = {axis: law for found in collected(planted, 'warming') for axis, law in found.items()}

    def temperatures(t: Array) -> Array:
        columns = [
            own[i](t) if i in own else start[i] + rise[i] * (1.0 - np.exp(-t / (0.7 * seconds)))
            for i in range(2)
        ]
        return np.column_stack(columns)

    return temperatures


def tracker(
    rng: np.random.Generator,
    machine: Machine,
    planted: list[Planted],
    ticks: Array,
    log: Array,
    warm: Any,
) -> tuple[Array, Array]:
    """Stamps (m,) and points (m, 2) of the tracker."""
    latency = sum(collected(planted, 'latency'))
    drift = sum(collected(planted, 'drift'))
    first = FIRST_POINT + rng.uniform(0.0, 1.0 / machine.tracker_rate)
    asked = np.arange(first, ticks[-1] - 1e-3, 1.0 / machine.tracker_rate)
    at = asked - latency
    tables = [law for laws in collected(planted, 'table') for law in laws]
    fine = np.linspace(0.0, ticks[-1], FINE * (len(ticks) - 1) + 1 if tables else 2)
    motor, points = np.zeros((len(fine), 2)), np.zeros((len(at), 2))
    for axis, letter in enumerate('xy'):
        carriage = CubicHermiteSpline(ticks, log[:, axis, 0], log[:, axis, 1])
        motor[:, axis] = carriage(fine)
        body = carriage
        if _seen(planted, 'sees_load', letter):
            body = CubicHermiteSpline(ticks, log[:, axis, 2], log[:, axis, 3])
        points[:, axis] = body(at)
        if _seen(planted, 'sees_base', letter):
            points[:, axis] += CubicHermiteSpline(ticks, log[:, axis, 4], log[:, axis, 5])(at)
    for displacement in tables:
        moved = displacement(motor, warm(fine), fine)
        for axis in range(2):
            points[:, axis] += np.interp(at, fine, moved[:, axis])
    for frame in collected(planted, 'frame'):
        c, s = np.cos(frame['angle']), np.sin(frame['angle'])
        points = points @ np.array([[c, s], [-s, c]])
        points += np.array([frame['offset_x'], frame['offset_y']])
    points += rng.normal(0.0, machine.tracker_noise, points.shape)
    return asked * (1.0 + drift), points


def temperatures(
    rng: np.random.Generator, machine: Machine, seconds: float, warm: Any
) -> tuple[Array, dict[str, Array]]:
    """Stamps (1 Hz) and readings [°C] of the four sensors."""
    stamps = np.arange(0.3, seconds, 1.0)
    screws = warm(stamps)
    true = {
        'screw_x': screws[:, 0],
        'screw_y': screws[:, 1],
        'frame': np.full(len(stamps), 0.3 * screws[0].mean()),
        'air': 0.1 * np.sin(stamps / 17.0),
    }
    return stamps, {
        name: machine.temperature_reference + values + rng.normal(0.0, SENSOR_NOISE, len(stamps))
        for name, values in true.items()
    }


def written_effort(effort: Array, planted: list[Planted]) -> Array:
    """The effort as the machine records it: maybe another sign or unit, maybe a magnitude."""
    out = effort.copy()
    for conventions in collected(planted, 'effort'):
        for axis, (factor, magnitude) in conventions.items():
            out[:, axis] *= factor
            if magnitude:
                out[:, axis] = np.abs(out[:, axis])
    return out
