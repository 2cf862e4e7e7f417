"""What is to be built and measured: a plan that each planted effect changes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from ..machine import Axis, Machine
from ..record import Planted

Array = np.ndarray
# Force [N] of position [m], speed [m/s] and time [s].
Force = Callable[[float, float, float], float]


@dataclass
class AxisPlan:
    """One axis, SI units; `mass` is all that moves with it."""

    controller: Axis
    mass: float
    damping: float
    resolution: float
    armature: float = 0.0
    stiffness: float = 0.0
    spring_reference: float = 0.0
    tilt: float = 0.0  # acceleration along the axis
    gear: float = 1.0
    force_range: float = np.inf
    lag: float = 0.0
    delay: float = 0.0
    sag: Force | None = None  # factor on the force, of commanded force, speed, time
    friction: Force | None = None  # friction loss
    presliding: float = 0.0
    load: tuple[float, float, float] | None = None  # mass, stiffness, damping
    drive: tuple[float, float] | None = None  # mass before a play, its width
    base: tuple[float, float, float] | None = None  # mass, stiffness, damping
    table_play: float = 0.0
    forces: list[Force] = field(default_factory=list)
    scale_errors: list[Callable[[float], float]] = field(default_factory=list)
    sees_load: bool = False
    sees_base: bool = False


@dataclass
class StagePlan:
    """Both axes and the instruments."""

    axes: tuple[AxisPlan, AxisPlan]
    # Sine of the angle by which the inner slide leans on the outer one, and the mass that rides on
    # both; the rest of the inner axis is inertia of its motor (armature).
    skew: float = 0.0
    riding: float = 0.0
    # Displacements (m, 2) of the table from positions (m, 2) and temperatures' laws.
    tables: list[Callable[[Array, Array], Array]] = field(default_factory=list)
    expansion: list[tuple[int, float, float, float, float]] = field(default_factory=list)
    frame: tuple[float, float, float] = (0.0, 0.0, 0.0)
    latency: float = 0.0
    drift: float = 0.0
    stamp_noise: float = 0.0
    efforts: list[Callable[[Array], Array]] = field(default_factory=list)
    rattle: tuple[float, float] | None = None


def planned(machine: Machine, planted: list[Planted]) -> StagePlan:
    """The nominal stage with all that is planted."""
    axes = [
        AxisPlan(axis, axis.mass, axis.viscous, axis.encoder_resolution, delay=axis.delay)
        for axis in machine.axes
    ]
    plan = StagePlan((axes[0], axes[1]))
    for one in planted:
        if 'change' in one.settings:
            one.settings['change'](plan)
    return plan
