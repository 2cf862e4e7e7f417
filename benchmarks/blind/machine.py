"""Reference motions, table geometry, temperatures and tracker of the blind machine."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.blind.plant import CONTROLLER, PLANT, run_axis, smooth_play
from stage_core.arrays import Array

#: The nominal machine as a twin file tells it: the numbers of interfaces.md, "Twin file".
NOMINAL: dict[str, Any] = {
    'kind': 'servo',
    'control_period': 0.001,
    'axes': {
        'x': {
            'mass': 18.0, 'viscous': 40.0, 'encoder_resolution': 1.0e-6, 'lead': 0.010,
            'position_gain': 40.0, 'velocity_feedforward': 0.0, 'velocity_gain': 3600.0,
            'integral_gain': 90000.0, 'velocity_filter': 1200.0, 'force_limit': 600.0,
            'delay': 0.0,
        },
        'y': {
            'mass': 8.0, 'viscous': 30.0, 'encoder_resolution': 1.0e-6, 'lead': 0.010,
            'position_gain': 40.0, 'velocity_feedforward': 0.0, 'velocity_gain': 1600.0,
            'integral_gain': 40000.0, 'velocity_filter': 1200.0, 'force_limit': 600.0,
            'delay': 0.0,
        },
    },
    'tracker': {'rate': 100.0, 'noise': 1.0e-6},
    'temperature_reference': 20.0,
}  # fmt: skip


@dataclass(frozen=True)
class Recording:
    """What the machine's recorder holds; positions [m], shape (n, a) or (m, a)."""

    axes: tuple[str, ...]
    time: Array
    reference: Array
    reference_velocity: Array
    velocity_command: Array
    force: Array
    encoder: Array
    filtered_velocity: Array
    tracker_time: Array
    tracker: Array
    temperature_time: Array
    temperature: Array


def moves(generator: np.random.Generator, duration: float, period: float) -> tuple[Array, Array]:
    """Reference (n,) and its velocity of one axis: quintic moves with dwells, then a sweep.

    Speeds from 5 to 150 mm/s over 60 mm of travel; the last quarter is a sinusoid whose
    amplitude shrinks while its frequency grows.
    """
    n = int(round(duration / period))
    t = np.arange(n) * period
    reference = np.zeros(n)
    at, position = 0.3, 0.0
    sweep = 0.75 * duration
    while at < sweep - 1.0:
        target = float(generator.uniform(-0.03, 0.03))
        distance = target - position
        speed = float(np.exp(generator.uniform(math.log(0.005), math.log(0.15))))
        length = min(max(1.875 * abs(distance) / speed, 0.25), sweep - at - 0.1, 4.0)
        first, last = np.searchsorted(t, (at, at + length))
        s = (t[first:last] - at) / length
        reference[first:last] += distance * s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
        reference[last:] += distance
        position = target
        at += length + float(generator.choice([0.0, 0.1, 0.3, 0.6]))
    u = np.clip((t - sweep) / (duration - sweep), 0.0, 1.0)
    cycles = (duration - sweep) * (0.4 * u + 1.2 * u**2)
    reference += 0.012 * (1.0 - 0.6 * u) * np.sin(2.0 * np.pi * cycles) * np.minimum(1, 12 * u)
    return reference, np.gradient(reference, period)


def record(
    truth: dict[str, dict[str, float]],
    seed: int,
    axes: tuple[str, ...] = ('x', 'y'),
    duration: float = 30.0,
    rate: float = 100.0,
    noise: float = 1.0e-6,
) -> Recording:
    """Run the machine with the effects of `truth` (``backlash.x``: its own parameters)."""
    generator = np.random.default_rng(seed)
    period = float(NOMINAL['control_period'])
    runs = []
    for axis in axes:
        reference, velocity = moves(generator, duration, period)
        nominal = NOMINAL['axes'][axis]
        plant, resolution = _plant(truth, axis, nominal)
        control = tuple(float(nominal[name]) for name in CONTROLLER)
        out = run_axis(period, reference, velocity, plant, control, resolution)
        runs.append((reference, velocity, *out))
    stack = [np.column_stack([run[j] for run in runs]) for j in range(7)]
    reference, velocity, motor, encoder, filtered, command, force = stack
    t = np.arange(len(reference), dtype=float) * period
    temperature_time = np.arange(0.0, duration, 1.0)
    warm = [float(generator.uniform(2.0, 9.0)) for _ in axes]
    lag = [float(generator.uniform(0.3, 1.0)) * duration for _ in axes]
    celsius = np.column_stack(
        [20.0 + w * (1.0 - np.exp(-temperature_time / c)) for w, c in zip(warm, lag, strict=True)]
    )
    table = _table(truth, axes, t, motor, temperature_time, celsius, generator)
    tracker_time, tracker = _measure(truth, axes, t, table, generator, rate, noise)
    return Recording(
        axes, t, reference, velocity, command, force, encoder, filtered, tracker_time, tracker,
        temperature_time, celsius + 0.005 * generator.standard_normal(celsius.shape),
    )  # fmt: skip


def _plant(
    truth: dict[str, dict[str, float]], axis: str, nominal: dict[str, float]
) -> tuple[tuple[float, ...], float]:
    values = dict.fromkeys(PLANT, 0.0)
    values.update(
        mass=nominal['mass'],
        viscous_positive=nominal['viscous'],
        viscous_negative=nominal['viscous'],
        stribeck_velocity=0.005,
        presliding=1.0e-5,
        ripple_period=nominal['lead'],
        drive_gain=1.0,
        saturation=1.0e9,
        payload_frequency=50.0,
        payload_damping=0.02,
    )
    resolution = nominal['encoder_resolution']
    for name, parameters in truth.items():
        _, _, effect_axis = name.partition('.')
        if effect_axis != axis:
            continue
        for key, value in parameters.items():
            if key == 'resolution':
                resolution = value
            elif key in values:
                values[key] += value if key.startswith(('coulomb', 'viscous', 'mass')) else 0.0
                if not key.startswith(('coulomb', 'viscous', 'mass')):
                    values[key] = value
    return tuple(float(values[name]) for name in PLANT), resolution


def _table(
    truth: dict[str, dict[str, float]],
    axes: tuple[str, ...],
    t: Array,
    motor: Array,
    temperature_time: Array,
    celsius: Array,
    generator: np.random.Generator,
) -> Array:
    table = motor.copy()
    for i, axis in enumerate(axes):
        p = motor[:, i]
        other = 1 - i
        for name, value in truth.items():
            effect, _, effect_axis = name.partition('.')
            if effect_axis != axis:
                continue
            if effect == 'scale_error':
                table[:, i] += value['scale'] * p
            elif effect == 'cyclic_pitch_error':
                angle = 2.0 * np.pi * p / value.get('period', 0.010) + value['phase']
                table[:, i] += value['amplitude'] * np.sin(angle)
            elif effect == 'backlash':
                table[:, i] += smooth_play(p, value['width'])
            elif effect == 'thermal_expansion':
                warm = np.interp(t, temperature_time, celsius[:, i]) - 20.0
                table[:, i] += value['coefficient'] * warm * (p - value['fixed'])
            elif effect == 'angular_error' and len(axes) == 2:
                # Yaw of the carriage, growing over the travel, seen at the other axis' arm.
                yaw = value['yaw'] * np.sin(p / 0.06)
                table[:, i] += (-1.0 if i == 0 else 1.0) * yaw * motor[:, other]
            elif effect == 'straightness' and len(axes) == 2:
                u = np.linspace(float(p.min()), float(p.max()), 500)
                bend = value['bow'] * np.cos(np.pi * (u - value['middle']) / 0.07)
                line = np.polyfit(u, bend, 1)
                bend = value['bow'] * np.cos(np.pi * (p - value['middle']) / 0.07)
                table[:, other] += bend - np.polyval(line, p)
            elif effect == 'hidden_drift':
                walk = np.cumsum(generator.standard_normal(len(t))) * np.sqrt(1e-3)
                table[:, i] += value['size'] * walk
            elif effect == 'hidden_grating':
                table[:, i] += value['size'] * np.sin(2.0 * np.pi * p / value['period'])
            elif effect == 'hidden_vibration':
                table[:, i] += value['size'] * np.sin(2.0 * np.pi * value['frequency'] * t)
    if 'nonorthogonality' in truth:
        skew = truth['nonorthogonality']['angle']
        table[:, 0] -= math.sin(skew) * motor[:, 1]
        table[:, 1] -= (1.0 - math.cos(skew)) * motor[:, 1]
    if 'hidden_twist' in truth:
        size = truth['hidden_twist']['size']
        table[:, 0] += size * np.sin(motor[:, 0] / 0.006) * np.sin(motor[:, 1] / 0.007)
    return table


def _measure(
    truth: dict[str, dict[str, float]],
    axes: tuple[str, ...],
    t: Array,
    table: Array,
    generator: np.random.Generator,
    rate: float,
    noise: float,
) -> tuple[Array, Array]:
    stamps = np.arange(0.05, t[-1] - 0.05, 1.0 / rate)
    true_time = stamps.copy()
    if 'tracker_latency' in truth:
        true_time -= truth['tracker_latency']['latency']
    if 'tracker_clock_drift' in truth:
        true_time /= 1.0 + truth['tracker_clock_drift']['drift']
    points = np.column_stack([np.interp(true_time, t, table[:, i]) for i in range(len(axes))])
    if 'tracker_misalignment' in truth:
        value = truth['tracker_misalignment']
        c, s = math.cos(value['angle']), math.sin(value['angle'])
        if len(axes) == 2:
            points = points @ np.array([[c, s], [-s, c]])
        points += np.array([value['offset_x'], value['offset_y']])[: len(axes)]
    return stamps, points + noise * generator.standard_normal(points.shape)
