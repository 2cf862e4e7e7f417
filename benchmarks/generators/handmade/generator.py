"""Draws effects and simulates sessions of the handmade stage."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..machine import Machine
from ..record import Planted, Record, Wish
from ..references import Reference
from . import drive_effects, measure, servo_effects, table_effects
from .kernel import run
from .settings import assembled

DRAWS = servo_effects.DRAWS | drive_effects.DRAWS | table_effects.DRAWS
STRANGE = table_effects.STRANGE | {'floor_vibration': drive_effects.floor_vibration}
GLOBAL_EFFECTS = tuple(name for name in DRAWS if name in table_effects.GLOBAL)
AXIS_EFFECTS = tuple(name for name in DRAWS if name not in GLOBAL_EFFECTS)
MECHANISMS = tuple(STRANGE)


def draw(rng: np.random.Generator, effect: str, wish: Wish) -> list[Planted]:
    """The effect or mechanism on the wish's axis; an effort's convention is often both axes'."""
    planted = (DRAWS | STRANGE)[effect](rng, wish)
    if effect != 'effort_convention' or rng.random() < 0.4:
        return [planted]
    factor, magnitude = planted.settings['effort'][wish.axis]
    other = 1 - wish.axis
    settings = {'effort': {other: (factor, magnitude)}}
    return [planted, replace(planted, axis='xy'[other], settings=settings)]


def simulate(machine: Machine, reference: Reference, planted: list[Planted], seed: int) -> Record:
    """One session; the same seed gives the same noise whatever is planted."""
    streams = [np.random.default_rng([seed, i]) for i in range(4)]
    period, n = machine.control_period, len(reference.position)
    grid = period * np.arange(n)
    jitter = sum(measure.collected(planted, 'jitter'))
    off = streams[0].normal(size=n) * np.hypot(machine.stamp_jitter, jitter)
    off[0] = 0.0
    ticks = grid + np.clip(off, -0.45 * period, 0.45 * period)
    noise = streams[1].normal(size=(n, 2)) * np.array(machine.encoder_noise)
    axes = [
        assembled(machine.axes[i], measure.collected(planted, letter))
        for i, letter in enumerate('xy')
    ]
    known, log = run(
        (axes[0], axes[1]), ticks, noise, reference.position, reference.velocity, period
    )
    warm = measure.warmth(streams[3], planted, n * period)
    # A machine that flies away is refused for its motor; the tracker's splines need numbers.
    seen = np.nan_to_num(log, posinf=0.0, neginf=0.0)
    points_at, points = measure.tracker(streams[2], machine, planted, ticks, seen, warm)
    warm_at, temperatures = measure.temperatures(streams[3], machine, n * period, warm)
    return Record(
        stamps=grid if jitter else ticks,
        reference=reference.position,
        reference_velocity=reference.velocity,
        command=known[:, :, 2],
        effort=measure.written_effort(known[:, :, 3], planted),
        encoder=known[:, :, 0],
        velocity=known[:, :, 1],
        tracker_stamps=points_at,
        tracker=points,
        temperature_stamps=warm_at,
        temperatures=temperatures,
        motor=log[:, :, 0],
        force=known[:, :, 3],
    )
