"""Effects between command and encoder: random structure, strengths of the size of the machine."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ..record import Planted, Wish

Rng = np.random.Generator
CURVE_POINTS = 4001


def planted_on_axis(
    wish: Wish,
    effect: str,
    settings: dict[str, Any],
    parameters: dict[str, float],
    **more: Any,
) -> Planted:
    """One effect on the wish's axis."""
    return Planted(
        effect,
        wish.letter,
        {k: float(v) for k, v in parameters.items()},
        settings={wish.letter: settings},
        **more,
    )


def _level(rng: Rng, wish: Wish) -> float:
    """A friction force of a guide that carries the axis' mass [N]."""
    return float(wish.size * (1.0 + wish.nominal.mass * rng.uniform(0.2, 1.2)))


def inertia_mismatch(rng: Rng, wish: Wish) -> Planted:
    """Another moving mass."""
    share = rng.uniform(0.12, 0.5) * wish.size * rng.choice([-0.6, 1.0])
    extra = wish.nominal.mass * max(-0.7, share)
    return planted_on_axis(wish, 'inertia_mismatch', {'mass+': extra}, {'mass': extra})


def viscous_friction(rng: Rng, wish: Wish) -> Planted:
    """Further viscous friction, in half of the cases with a quadratic part (churned grease)."""
    force = rng.uniform(0.1, 0.5) * wish.size * (wish.forces[0] + 2.0)
    viscous = force / max(wish.speeds[0], 1e-3)
    bend = rng.uniform(0.1, 0.4) if rng.random() < 0.4 else 0.0
    quadratic = bend * viscous / max(wish.speeds[1], 1e-3)
    return planted_on_axis(
        wish,
        'viscous_friction',
        {'viscous+': viscous, 'quadratic': quadratic},
        {'viscous': viscous} if not bend else {},
        shape={'quadratic': quadratic, 'viscous': viscous},
    )


def coulomb_friction(rng: Rng, wish: Wish) -> Planted:
    """Friction of one level."""
    level, presliding = _level(rng, wish), rng.uniform(5e-7, 1.5e-5)
    settings = {'coulomb': np.array([level, level]), 'presliding': presliding}
    return planted_on_axis(wish, 'coulomb_friction', settings, {'coulomb': level},
                    shape={'presliding': presliding})  # fmt: skip


def asymmetric_friction(rng: Rng, wish: Wish) -> Planted:
    """Friction whose level, and in half of the cases viscosity, goes with the direction."""
    level, presliding = _level(rng, wish), rng.uniform(5e-7, 1.5e-5)
    share = rng.uniform(0.15, 0.45) * rng.choice([-1.0, 1.0])
    both = level * np.array([1.0 + share, 1.0 - share])
    sides = np.zeros(2)
    if rng.random() < 0.5:
        sides = 0.2 * level / max(wish.speeds[1], 0.01) * rng.uniform(0.0, 1.0, 2)
    settings = {'coulomb': both, 'presliding': presliding, 'viscous_side': sides}
    return planted_on_axis(
        wish,
        'asymmetric_friction',
        settings,
        {'coulomb_positive': both[0], 'coulomb_negative': both[1]},
        shape={'presliding': presliding, 'viscous_sides': sides.tolist()},
        companions=('coulomb_friction', 'viscous_friction') if sides.any()
        else ('coulomb_friction',),
    )  # fmt: skip


def stribeck_friction(rng: Rng, wish: Wish) -> Planted:
    """Static friction of 1.5 to 4 times the Coulomb level."""
    level, ratio = 0.6 * _level(rng, wish), rng.uniform(1.5, 4.0)
    speed, power = rng.uniform(0.002, 0.02), rng.choice([1.0, 2.0])
    presliding = rng.uniform(1e-6, 1.5e-5)
    settings = {
        'coulomb': np.array([level, level]), 'static': ratio * level, 'stribeck_speed': speed,
        'stribeck_power': power, 'presliding': presliding,
    }  # fmt: skip
    return planted_on_axis(
        wish,
        'stribeck_friction',
        settings,
        {'coulomb': level, 'static': ratio * level, 'stribeck_velocity': speed},
        shape={'power': float(power), 'presliding': presliding},
        companions=('coulomb_friction',),
    )


def position_dependent_friction(rng: Rng, wish: Wish) -> Planted:
    """Friction that swells along the travel: a bent rail, dirt, a pinched wiper."""
    level, presliding = _level(rng, wish), rng.uniform(5e-7, 1e-5)
    positions, curve = _smooth_curve(rng, wish)
    factor = 1.0 + rng.uniform(0.3, 0.7) * curve
    settings = {
        'coulomb': np.array([level, level]), 'presliding': presliding,
        'curve_start': positions[0], 'curve_step': positions[1] - positions[0],
        'friction_curve': factor,
    }  # fmt: skip
    return planted_on_axis(
        wish,
        'position_dependent_friction',
        settings,
        {'coulomb': level},
        shape={'positions': positions[::400].tolist(), 'factor': factor[::400].tolist()},
        companions=('coulomb_friction',),
    )


def _smooth_curve(rng: Rng, wish: Wish) -> tuple[np.ndarray, np.ndarray]:
    """Sum of three slow waves over the travelled range, mean 0 and peak 1."""
    low, high = wish.travelled
    margin = 0.1 * (high - low) + 0.002
    positions = np.linspace(low - margin, high + margin, CURVE_POINTS)
    length = positions[-1] - positions[0]
    curve = np.zeros(CURVE_POINTS)
    for turns in (rng.uniform(0.5, 0.9), rng.uniform(0.9, 1.6), rng.uniform(1.6, 2.4)):
        phase = rng.uniform(0.0, 2.0 * np.pi)
        curve += rng.normal() * np.sin(2.0 * np.pi * turns * positions / length + phase)
    curve -= curve.mean()
    return positions, curve / np.abs(curve).max()


def position_force(rng: Rng, wish: Wish) -> Planted:
    """A smooth force of the position: counterweight on a cam, bellows, magnets of a rail."""
    positions, curve = _smooth_curve(rng, wish)
    force = _level(rng, wish) * 1.5 * curve
    settings = {
        'curve_start': positions[0],
        'curve_step': positions[1] - positions[0],
        'force_curve': force,
    }
    low, high = wish.travelled
    seen = force[(positions >= low) & (positions <= high)]
    return planted_on_axis(
        wish,
        'position_force',
        settings,
        {'peak_to_peak': float(np.ptp(seen)) if len(seen) else 0.0},
        shape={'positions': positions[::200].tolist(), 'force': force[::200].tolist()},
        companions=('force_offset', 'cable_force'),
    )


def cable_force(rng: Rng, wish: Wish) -> Planted:
    """A spring to some place; in half of the cases one that hardens."""
    low, high = wish.travelled
    reach = max(high - low, 0.002)
    centre = rng.uniform(low - 0.3 * reach, high + 0.3 * reach)
    stiffness = 1.5 * _level(rng, wish) / reach
    hardening = stiffness / reach**2 * rng.uniform(0.5, 3.0) if rng.random() < 0.5 else 0.0
    settings = {'spring': stiffness, 'hardening': hardening, 'spring_centre': centre}
    return planted_on_axis(
        wish,
        'cable_force',
        settings,
        {'stiffness': stiffness, 'centre': centre, 'hardening': hardening},
        companions=('force_offset',),
        instead=('position_force',) if hardening else (),
    )


def force_offset(rng: Rng, wish: Wish) -> Planted:
    """A constant force: a tilted axis, a bias of the amplifier."""
    offset = _level(rng, wish) * rng.choice([-1.0, 1.0])
    return planted_on_axis(wish, 'force_offset', {'offset': offset}, {'offset': offset})


def force_ripple(rng: Rng, wish: Wish) -> Planted:
    """Force waves of magnets, slots or balls: a period of their own, up to three harmonics."""
    lead = wish.nominal.lead
    period = float(rng.choice([lead, lead / 2, 0.03, 0.024, lead * rng.uniform(0.15, 1.9)]))
    low, high = wish.travelled
    period = min(period, max(high - low, 0.002) / 2.5)
    amplitude = 0.7 * _level(rng, wish)
    rows = _harmonics(rng, amplitude, period)
    return planted_on_axis(
        wish,
        'force_ripple',
        {'ripple+': rows},
        {'amplitude': amplitude, 'period': period, 'phase': rows[0, 2]},
        shape={'harmonics': rows.tolist()},
    )


def _harmonics(rng: Rng, amplitude: float, period: float) -> np.ndarray:
    """Rows of amplitude, wave number, phase: the first wave and up to two weaker ones."""
    orders = [1, *rng.permutation([2, 3, 4])[: rng.integers(0, 3)]]
    return np.array(
        [
            [
                amplitude * (1.0 if order == 1 else rng.uniform(0.08, 0.4)),
                2.0 * np.pi * order / period,
                rng.uniform(0.0, 2.0 * np.pi),
            ]
            for order in orders
        ]
    )


def axis_crosstalk(rng: Rng, wish: Wish) -> Planted:
    """Force from the other axis' acceleration, in some cases also from its speed."""
    mass = 0.15 * wish.size * wish.nominal.mass * rng.uniform(0.3, 1.0) * rng.choice([-1.0, 1.0])
    viscous = rng.uniform(0.5, 2.0) * mass if rng.random() < 0.4 else 0.0
    settings = {'cross_mass': mass, 'cross_viscous': viscous}
    return planted_on_axis(wish, 'axis_crosstalk', settings, {'mass': mass, 'viscous': viscous})


DRAWS: dict[str, Callable[[Rng, Wish], Planted]] = {
    draw.__name__: draw
    for draw in (
        inertia_mismatch, viscous_friction, coulomb_friction, asymmetric_friction,
        stribeck_friction, position_dependent_friction, position_force, cable_force,
        force_offset, force_ripple, axis_crosstalk,
    )
}  # fmt: skip
