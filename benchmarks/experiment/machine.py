"""Machines with one effect, and sessions of little motion: simulated with the twin."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from stage_core import topics
from stage_core.arrays import Array
from stage_core.clocks import to_stamps
from stage_core.session import Series, Session, by_topic
from stage_core.twin_file import TrackerSpec, TwinFile
from stage_twin.effects import EFFECTS
from stage_twin.simulate import SimulationResult, simulate

Effects = Mapping[str, Mapping[str, float]]

START = 1_750_000_000_000_000_000
PERIOD = 0.001
DURATION = 12.0  # s, of the first session
AXES = ('x', 'y')
#: What is planted, one at a time. Of the others no motion decides (a convention, a jitter, a
#: coarse encoder), or a temperature does.
PLANTED = (
    'inertia_mismatch', 'viscous_friction', 'coulomb_friction', 'asymmetric_friction',
    'stribeck_friction', 'force_offset', 'force_ripple', 'cable_force', 'position_force',
    'drive_gain', 'current_loop_lag', 'actuation_delay', 'position_dependent_friction',
    'torque_sag', 'scale_error', 'cyclic_pitch_error', 'straightness', 'backlash',
    'angular_error', 'nonorthogonality', 'tracker_latency',
)  # fmt: skip
#: In place of the sizes that the catalogue of effects shows: the forces of these motions are some
#: 20 N, of which its sag, made for hundreds of newtons, would take a hundredth.
SIZES = {'torque_sag': {'sag_force': 0.01}}
MOTIONS = ('one_way', 'one_speed', 'small', 'diagonal')


@dataclass(frozen=True)
class Case:
    """One machine and the motion of its first session."""

    seed: int
    effect: str
    values: Mapping[str, float]
    motion: str


def draw(seed: int) -> Case:
    """The case of a seed: effects and motions in turn, sizes by chance."""
    generator = np.random.default_rng(seed)
    name = PLANTED[seed % len(PLANTED)]
    effect = EFFECTS[name]
    values = effect.defaults()
    for parameter in effect.parameters:
        if parameter.fitted and parameter.neutral is not None:
            factor = math.exp(generator.uniform(math.log(0.7), math.log(2.0)))
            value = SIZES.get(name, {}).get(parameter.name, parameter.when_on) * factor
            values[parameter.name] = float(np.clip(value, parameter.minimum, parameter.maximum))
    axis = f'.{generator.choice(AXES)}' if effect.per_axis else ''
    motion = MOTIONS[(seed + seed // len(PLANTED)) % len(MOTIONS)]
    return Case(seed, name + axis, values, motion)


def poor_motion(case: Case) -> Array:
    """Reference (n, 2) [m] of the first session: little of what would tell effects apart."""
    generator = np.random.default_rng(1000 + case.seed)
    t = np.arange(round(DURATION / PERIOD), dtype=float) * PERIOD
    if case.motion == 'one_way':
        steps = [_strokes(t, generator, 0.004, forth=True) for _ in AXES]
    elif case.motion == 'one_speed':
        steps = [_strokes(t, generator, 0.012, forth=False) for _ in AXES]
    elif case.motion == 'small':
        steps = [
            _faded(t, 0.002 * np.sin(2.0 * np.pi * generator.uniform(0.3, 0.6) * t)) for _ in AXES
        ]
    else:
        one = _strokes(t, generator, 0.010, forth=False)
        steps = [one, one]
    return np.column_stack(steps)


def _faded(t: Array, values: Array) -> Array:
    return np.asarray(values * np.minimum(1.0, t) * np.minimum(1.0, t[-1] - t))


def _strokes(t: Array, generator: np.random.Generator, length: float, forth: bool) -> Array:
    """Equal smooth strokes of one duration with rests: forth only, or forth and back."""
    out, at, sign = np.zeros_like(t), 0.4, 1.0
    lasting = float(generator.uniform(0.9, 1.3))
    while at < t[-1] - lasting - 0.2:
        s = np.clip((t - at) / lasting, 0.0, 1.0)
        out += sign * length * s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
        at += lasting + 0.3
        sign = sign if forth else -sign
    return out


def nominal() -> TwinFile:
    """The nominal machine, with a tracker."""
    return replace(TwinFile.nominal_servo(), tracker=TrackerSpec(100.0, 1e-6))


def record(case: Case, position: Array, seed: int, name: str) -> Session:
    """What a bag holds of the machine of a case on a reference (n, 2) [m]."""
    machine = nominal().with_effects({case.effect: case.values})
    rise = 20.0 + 4.0 * (1.0 - np.exp(-np.arange(len(position)) * PERIOD / 60.0))
    return session(machine, nominal(), position, rise, seed, START + seed * 10**13, name)


def session(
    machine: TwinFile,
    carried: TwinFile,
    position: Array,
    warmth: Array,
    seed: int,
    start: int = START,
    name: str = 'planted',
) -> Session:
    """What a bag of the twin file `carried` holds of a machine on a reference (n, n_axes) [m].

    `warmth` (n,) [degC] is the temperature of every screw, `start` the first stamp [ns].
    """
    rate = np.gradient(position, machine.control_period, axis=0)
    warm = np.tile(warmth[:, None], (1, len(machine.axes)))
    made = simulate(machine, position, rate, temperatures=warm, seed=seed)
    found = as_session(made, carried, position, start, name)
    seconds = np.arange(0.0, len(position) * machine.control_period, 1.0)
    values = {'temperature': np.interp(seconds, made.times, warmth)}
    for axis in machine.axes:
        key = topics.temperature_key(f'screw_{axis}')
        found.series[key] = Series(topics.TEMPERATURE, to_stamps(seconds, start), dict(values))
    return found


def as_session(
    made: SimulationResult, carried: TwinFile, position: Array, start: int, name: str
) -> Session:
    """What a bag holds of a run on a reference (n, n_axes) [m], temperatures apart."""
    rate = np.gradient(position, carried.control_period, axis=0)

    ticks, axes = to_stamps(made.times, start), tuple(carried.axes)
    found = by_topic(
        Series.per_axis(topics.REFERENCE, ticks, axes, position=position, velocity=rate),
        Series.per_axis(
            topics.COMMAND, ticks, axes, velocity=made.velocity_command, effort=made.force
        ),
        Series.per_axis(
            topics.JOINT_STATES, ticks, axes, position=made.encoder, velocity=made.velocity
        ),
        Series.points(
            topics.TRACKER_POINT, to_stamps(made.tracker_stamps, start), made.tracker_points
        ),
    )
    return Session(name, found, carried.to_dict(), None)
