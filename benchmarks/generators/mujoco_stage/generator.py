"""Draws effects and simulates sessions of the MuJoCo stage."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from ..machine import Machine
from ..record import Planted, Record, Wish
from ..references import Reference
from . import drives, instruments, servo
from .loop import Motion, run
from .plan import Array, StagePlan, planned

DRAWS = servo.DRAWS | drives.DRAWS | instruments.DRAWS
STRANGE = servo.STRANGE | instruments.STRANGE
GLOBAL_EFFECTS = tuple(name for name in DRAWS if name in instruments.GLOBAL)
AXIS_EFFECTS = tuple(name for name in DRAWS if name not in GLOBAL_EFFECTS)
MECHANISMS = tuple(STRANGE)
# The tracker's first point [s], after the longest latency.
FIRST_POINT = 0.03


def draw(rng: np.random.Generator, effect: str, wish: Wish) -> list[Planted]:
    """The effect or mechanism on the wish's axis; one cause may name both axes."""
    planted = (DRAWS | STRANGE)[effect](rng, wish)
    return planted if isinstance(planted, list) else [planted]


def simulate(machine: Machine, reference: Reference, planted: list[Planted], seed: int) -> Record:
    """One session; the same seed gives the same noise whatever is planted."""
    timing, encoder, points, climate = (np.random.default_rng([seed, i, 77]) for i in range(4))
    plan = planned(machine, planted)
    period, n = machine.control_period, len(reference.position)
    bound = 0.4 * period
    off = np.clip(timing.normal(0.0, 1.0, n) * machine.stamp_jitter, -bound, bound)
    off[0] = 0.0
    ticks = period * np.arange(n) + off
    noise = encoder.normal(size=(n, 2)) * np.array(machine.encoder_noise)
    motion = run(plan, ticks, noise, reference.position, reference.velocity, period)
    late = np.clip(timing.normal(0.0, 1.0, n) * plan.stamp_noise, -bound, bound)
    late[0] = 0.0
    warm = _warmth(climate, plan, ticks, motion.speeds[:, :, 0])
    stamps, seen = _tracked(points, machine, plan, ticks, motion, warm)
    at, temperatures = _temperatures(climate, machine, ticks, warm)
    effort = motion.force
    for written in plan.efforts:
        effort = written(effort)
    return Record(
        stamps=ticks + late,
        reference=reference.position,
        reference_velocity=reference.velocity,
        command=motion.command,
        effort=effort,
        encoder=motion.encoder,
        velocity=motion.velocity,
        tracker_stamps=stamps,
        tracker=seen,
        temperature_stamps=at,
        temperatures=temperatures,
        motor=motion.tracks[:, :, 0],
        force=motion.force,
    )


def _warmth(rng: np.random.Generator, plan: StagePlan, ticks: Array, speed: Array) -> Array:
    """Temperatures of the screws above the reference at the ticks (n, 2) [K].

    The nut's friction heats them as they turn. Where nothing expands it does so, too.
    """
    out = np.zeros((len(ticks), 2))
    step = float(ticks[1] - ticks[0])
    planted = {axis: (rise, tau) for axis, _, _, rise, tau in plan.expansion if tau > 0.0}
    starts = {axis: start for axis, _, _, start, tau in plan.expansion if tau < 0.0}
    for axis in range(2):
        own = (float(rng.choice([0.0, 1.0, 3.0])), 40.0)
        level = float(rng.normal(0.0, 0.4))
        rise, tau = planted.get(axis, own)
        power = np.abs(speed[:, axis])
        heat, keep = 0.0, np.exp(-step / tau)
        track = np.empty(len(ticks))
        for k, watts in enumerate(power / max(float(power.mean()), 1e-9)):
            heat = keep * heat + (1.0 - keep) * watts
            track[k] = heat
        out[:, axis] = starts.get(axis, level) + rise * track
    return out


def _tracked(
    rng: np.random.Generator,
    machine: Machine,
    plan: StagePlan,
    ticks: Array,
    motion: Motion,
    warm: Array,
) -> tuple[Array, Array]:
    """Stamps (m,) and points (m, 2) of the tracker."""
    gap = 1.0 / machine.tracker_rate
    asked = np.arange(FIRST_POINT + gap * rng.random(), ticks[-1] - 1e-3, gap)
    at = asked - plan.latency
    motors, points = np.zeros((len(at), 2)), np.zeros((len(at), 2))
    for i, axis in enumerate(plan.axes):

        def body(column: int, i: int = i) -> Array:
            path, speed = motion.tracks[:, i, column], motion.speeds[:, i, column]
            return np.asarray(CubicHermiteSpline(ticks, path, speed)(at))

        motors[:, i] = body(0)
        points[:, i] = body(1) if axis.sees_load else body(3) if axis.table_play else motors[:, i]
        points[:, i] += body(2) if axis.sees_base else 0.0
        if plan.rattle:
            points[:, i] += np.interp(at, ticks, _rattled(ticks, motion.speeds[:, i, 0], plan))
    for displacement in plan.tables:
        points += displacement(motors, at)
    for i, alpha, fixed, _, _ in plan.expansion:
        points[:, i] += alpha * np.interp(at, ticks, warm[:, i]) * (motors[:, i] - fixed)
    angle, *shift = plan.frame
    x, y = points.T
    c, s = np.cos(angle), np.sin(angle)
    points = np.column_stack([c * x - s * y, s * x + c * y]) + np.array(shift)
    points += rng.normal(0.0, machine.tracker_noise, points.shape)
    return asked * (1.0 + plan.drift), points


def _rattled(ticks: Array, speed: Array, plan: StagePlan) -> Array:
    """Place of a reflector that slips towards a side when the acceleration passes a bound."""
    bound, size = plan.rattle or (1.0, 0.0)
    step = float(ticks[1] - ticks[0])
    smooth = np.convolve(np.gradient(speed, step), np.ones(20) / 20, mode='same')
    place, out = 0.0, np.empty(len(ticks))
    for k, acceleration in enumerate(smooth):
        if abs(acceleration) > bound:
            goal = -size * np.sign(acceleration)
            place += (goal - place) * min(1.0, step / 0.01)
        out[k] = place
    return out


def _temperatures(
    rng: np.random.Generator, machine: Machine, ticks: Array, warm: Array
) -> tuple[Array, dict[str, Array]]:
    """Stamps (1 Hz) and readings [°C]."""
    at = np.arange(0.5, ticks[-1], 1.0)
    true = {
        'screw_x': np.interp(at, ticks, warm[:, 0]),
        'screw_y': np.interp(at, ticks, warm[:, 1]),
        'frame': np.interp(at, ticks, 0.2 * warm.mean(axis=1)),
        'air': np.full(len(at), 0.1),
    }
    return at, {
        name: machine.temperature_reference + values + rng.normal(0.0, 0.015, len(at))
        for name, values in true.items()
    }
