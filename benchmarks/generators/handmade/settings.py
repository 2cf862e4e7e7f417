"""All that can be other than nominal on one axis, and how drawn settings are put together."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np

from ..machine import Axis

# Shares of the friction and yield distances of the Maxwell elements, relative to `presliding`.
SHARES = np.array([0.30, 0.28, 0.22, 0.20])
YIELDS = np.array([0.15, 0.35, 0.65, 1.0])
# Smallest friction distance: shorter ones cannot be told from it at any tracker's noise.
HARD_STOP = 1e-7


class AxisSettings(NamedTuple):
    """Physics and controller of one axis (SI). Curves are tables over `curve_start + i·step`."""

    mass: float
    viscous: float
    # Controller.
    resolution: float
    position_gain: float
    feedforward: float
    velocity_gain: float
    integral_gain: float
    filter: float
    limit: float
    # Drive: amplifier, lag, sag.
    gain: float
    clip: float
    delay: float
    lag: float
    sag_force: float
    sag_speed: float
    sag_heat: float
    heat_time: float
    # Forces on the carriage.
    coulomb: np.ndarray  # positive, negative direction
    static: float
    stribeck_speed: float
    stribeck_power: float
    presliding: float
    viscous_side: np.ndarray  # further viscous friction of each direction
    quadratic: float
    offset: float
    spring: float
    hardening: float
    spring_centre: float
    ripple: np.ndarray  # (harmonics, 3): amplitude, wave number, phase
    curve_start: float
    curve_step: float
    force_curve: np.ndarray
    friction_curve: np.ndarray  # factor of the friction level
    cross_mass: float
    cross_viscous: float
    shake: np.ndarray  # (lines, 3) of time: amplitude, angular frequency, phase
    # Second bodies.
    load: float
    load_stiffness: float
    load_damping: float
    drive_mass: float
    play: float
    play_stiffness: float
    play_damping: float
    base: float
    base_stiffness: float
    base_damping: float
    # Encoder.
    wave: np.ndarray  # (harmonics, 3): amplitude, wave number, phase


def nominal(axis: Axis) -> AxisSettings:
    """The twin file's axis: nothing but mass, viscous friction and the controller."""
    return AxisSettings(
        mass=axis.mass, viscous=axis.viscous, resolution=axis.encoder_resolution,
        position_gain=axis.position_gain, feedforward=axis.velocity_feedforward,
        velocity_gain=axis.velocity_gain, integral_gain=axis.integral_gain,
        filter=axis.velocity_filter, limit=axis.force_limit,
        gain=1.0, clip=np.inf, delay=axis.delay, lag=0.0,
        sag_force=0.0, sag_speed=0.0, sag_heat=0.0, heat_time=1.0,
        coulomb=np.zeros(2), static=0.0, stribeck_speed=1.0, stribeck_power=1.0,
        presliding=HARD_STOP, viscous_side=np.zeros(2), quadratic=0.0,
        offset=0.0, spring=0.0, hardening=0.0, spring_centre=0.0, ripple=np.zeros((0, 3)),
        curve_start=0.0, curve_step=1.0, force_curve=np.zeros(2), friction_curve=np.ones(2),
        cross_mass=0.0, cross_viscous=0.0, shake=np.zeros((0, 3)),
        load=0.0, load_stiffness=0.0, load_damping=0.0,
        drive_mass=0.0, play=0.0, play_stiffness=0.0, play_damping=0.0,
        base=0.0, base_stiffness=0.0, base_damping=0.0, wave=np.zeros((0, 3)),
    )  # fmt: skip


def assembled(axis: Axis, changes: Iterable[dict[str, Any]]) -> AxisSettings:
    """The nominal axis with the settings of all that is planted on it.

    A key that ends in `*` multiplies, one in `+` adds (rows, for tables); others replace.
    """
    settings = nominal(axis)._asdict()
    for change in changes:
        for key, value in change.items():
            name = key.rstrip('*+')
            if key.endswith('*'):
                settings[name] = settings[name] * value
            elif key.endswith('+'):
                old = settings[name]
                rows = isinstance(old, np.ndarray) and old.ndim == 2
                settings[name] = np.concatenate([old, value]) if rows else old + value
            else:
                settings[name] = value
    return AxisSettings(**settings)
