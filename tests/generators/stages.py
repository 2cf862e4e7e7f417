"""A stage and short paths that the tests of both generators share."""

from __future__ import annotations

import numpy as np

from benchmarks.generators.machine import Axis, Machine
from benchmarks.generators.record import Record
from benchmarks.generators.references import Reference


def stage(noise: float = 0.0, resolution: float = 1e-7) -> Machine:
    """Two axes of 10 kg without stamp jitter, whose tracker is nearly perfect unless asked."""
    axis = Axis(
        mass=10.0, viscous=20.0, encoder_resolution=resolution, lead=0.01, position_gain=40.0,
        velocity_feedforward=0.0, velocity_gain=2000.0, integral_gain=40000.0,
        velocity_filter=1200.0, force_limit=150.0,
    )  # fmt: skip
    return Machine(
        0.001, (axis, axis), 200.0, max(noise, 1e-10), 20.0, (noise, noise), 0.0,
        (0.1, 0.1), (0.2, 0.2), (3.0, 3.0),
    )  # fmt: skip


def waves(seconds: float = 4.0) -> Reference:
    """There and back on both axes, at rest at the start."""
    t = 0.001 * np.arange(round(seconds * 1000))
    s = np.clip(t / 0.5, 0.0, 1.0)
    rise, slope = s**3 * (10 - 15 * s + 6 * s**2), 60.0 * s**2 * (1 - s) ** 2
    columns, speeds = [], []
    for size, rate in ((0.03, 5.0), (0.02, 7.3)):
        columns.append(size * rise * np.sin(rate * t))
        speeds.append(size * (slope * np.sin(rate * t) + rise * rate * np.cos(rate * t)))
    return Reference(np.column_stack(columns), np.column_stack(speeds), ('waves',))


def assert_controlled(record: Record, ticks: int) -> None:
    """The forces of x are those of interfaces.md, "Servo controller", on what it has read."""
    axis = stage().axes[0]
    pole, integral, speed = np.exp(-0.001 * axis.velocity_filter), 0.0, 0.0
    last = record.encoder[0, 0]
    for k in range(ticks):
        q, r = record.encoder[k, 0], record.reference[k, 0]
        speed = pole * speed + (1 - pole) * (q - last) / 0.001
        last = q
        error = axis.position_gain * (r - q) - speed
        force = axis.velocity_gain * error + integral
        assert abs(record.force[k, 0] - force) < 1e-9
        integral += axis.integral_gain * error * 0.001


def rest(seconds: float = 1.0) -> Reference:
    """No motion at all."""
    nothing = np.zeros((round(seconds * 1000), 2))
    return Reference(nothing, nothing, ('rest',))
