"""Effects of masses, guides, cables and magnets, as joints and forces of the model."""

from __future__ import annotations

from collections.abc import Callable
from math import cos, exp, pi, sin
from typing import Any

import numpy as np

from ..record import Planted, Wish
from .plan import AxisPlan, Force, StagePlan

Rng = np.random.Generator


def planted(
    wish: Wish,
    effect: str,
    change: Callable[[AxisPlan], None],
    parameters: dict[str, float],
    **more: Any,
) -> Planted:
    """One effect that changes the plan of the wish's axis."""
    number = wish.axis

    def on_stage(plan: StagePlan) -> None:
        change(plan.axes[number])

    values = {key: float(value) for key, value in parameters.items()}
    return Planted(effect, wish.letter, values, settings={'change': on_stage}, **more)


def sets(**values: Any) -> Callable[[AxisPlan], None]:
    """A change that sets fields of the axis' plan."""

    def change(axis: AxisPlan) -> None:
        for key, value in values.items():
            setattr(axis, key, value)

    return change


def acts(law: Force) -> Callable[[AxisPlan], None]:
    """A change that adds a force to those on the axis."""
    return lambda axis: axis.forces.append(law)


def _newtons(rng: Rng, wish: Wish, share: float = 1.0) -> float:
    """A force of the size that guides, cables and magnets of such an axis have [N]."""
    return float(share * wish.size * rng.uniform(0.02, 0.12) * 9.81 * (wish.nominal.mass + 3.0))


def inertia_mismatch(rng: Rng, wish: Wish) -> Planted:
    """A payload, or the inertia of the motor (armature) that the file forgot."""
    extra = wish.nominal.mass * wish.size * rng.uniform(0.15, 0.6)
    return _payload(wish, extra, bool(rng.random() < 0.5))


def _payload(wish: Wish, extra: float, armature: bool) -> Planted:
    def change(axis: AxisPlan) -> None:
        axis.mass += extra
        axis.armature += extra if armature else 0.0

    shape = {'as': 'armature' if armature else 'payload'}
    return planted(wish, 'inertia_mismatch', change, {'mass': extra}, shape=shape)


def viscous_friction(rng: Rng, wish: Wish) -> Planted:
    """Joint damping beside the file's."""
    extra = _newtons(rng, wish, 2.0) / max(wish.speeds[1], 2e-3)

    def change(axis: AxisPlan) -> None:
        axis.damping += extra

    return planted(wish, 'viscous_friction', change, {'viscous': extra})


def coulomb_friction(rng: Rng, wish: Wish) -> Planted:
    """Friction loss of the slide, or of a wiper that hangs on it by a spring (pre-sliding)."""
    level, presliding = _newtons(rng, wish), _presliding(rng)
    change = sets(friction=lambda p, v, t: level, presliding=presliding)
    return planted(wish, 'coulomb_friction', change, {'coulomb': level},
                   shape={'presliding': presliding})  # fmt: skip


def _presliding(rng: Rng) -> float:
    return float(rng.uniform(2e-6, 1.2e-5)) if rng.random() < 0.6 else 0.0


def asymmetric_friction(rng: Rng, wish: Wish) -> Planted:
    """Other friction loss forwards than backwards."""
    level, share = _newtons(rng, wish), rng.uniform(0.2, 0.5) * rng.choice([-1.0, 1.0])
    plus, minus = level * (1.0 + share), level * (1.0 - share)
    change = sets(friction=lambda p, v, t: plus if v >= 0.0 else minus)
    return planted(
        wish, 'asymmetric_friction', change,
        {'coulomb_positive': plus, 'coulomb_negative': minus}, companions=('coulomb_friction',),
    )  # fmt: skip


def stribeck_friction(rng: Rng, wish: Wish) -> Planted:
    """Friction loss that falls with the speed, hyperbolically or exponentially."""
    level, ratio = _newtons(rng, wish, 0.5), rng.uniform(1.6, 3.5)
    speed, bell = rng.uniform(0.002, 0.015), bool(rng.random() < 0.5)

    def friction(p: float, v: float, t: float) -> float:
        x = abs(v) / speed
        return level * (1.0 + (ratio - 1.0) * (exp(-x * x) if bell else 1.0 / (1.0 + x * x)))

    change = sets(friction=friction, presliding=_presliding(rng))
    values = {'coulomb': level, 'static': ratio * level}
    return planted(
        wish, 'stribeck_friction', change, values | ({'stribeck_velocity': speed} if bell else {}),
        shape={'fall': 'exponential' if bell else 'hyperbolic', 'speed': speed},
        companions=('coulomb_friction',),
    )  # fmt: skip


def position_dependent_friction(rng: Rng, wish: Wish) -> Planted:
    """A guide that pinches at one place or towards one end."""
    level = _newtons(rng, wish)
    low, high = wish.travelled
    place, reach = rng.uniform(low, high), rng.uniform(0.15, 0.5) * max(high - low, 1e-3)
    rise = rng.uniform(0.8, 2.0)

    def friction(p: float, v: float, t: float) -> float:
        return level * (1.0 + rise * exp(-(((p - place) / reach) ** 2)))

    return planted(
        wish, 'position_dependent_friction', sets(friction=friction), {},
        shape={'level': level, 'rise': rise, 'place': place, 'reach': reach},
        companions=('coulomb_friction',),
    )  # fmt: skip


def force_offset(rng: Rng, wish: Wish) -> Planted:
    """The axis leans: gravity pulls along it."""
    pull = 0.5 * _newtons(rng, wish) / wish.nominal.mass * rng.choice([-1.0, 1.0])
    # Gravity pulls at the whole stage: the axis' own mass is the nominal one unless planted.
    change = sets(tilt=pull)
    return planted(wish, 'force_offset', change, {'offset': pull * wish.nominal.mass})


def cable_force(rng: Rng, wish: Wish) -> Planted:
    """A joint spring, in half of the cases one that hardens."""
    low, high = wish.travelled
    reach = max(high - low, 0.003)
    stiffness = _newtons(rng, wish, 2.5) / reach
    centre = float(rng.choice([low, high, 0.5 * (low + high)]) + 0.1 * reach * rng.normal())
    cubic = stiffness / reach**2 * rng.uniform(0.8, 4.0) if rng.random() < 0.5 else 0.0

    def change(axis: AxisPlan) -> None:
        axis.stiffness, axis.spring_reference = stiffness, centre
        if cubic:
            axis.forces.append(lambda p, v, t: -cubic * (p - centre) ** 3)

    return planted(
        wish, 'cable_force', change,
        {'stiffness': stiffness, 'centre': centre, 'hardening': cubic},
        companions=('force_offset',), instead=('position_force',) if cubic else (),
    )  # fmt: skip


def position_force(rng: Rng, wish: Wish) -> Planted:
    """A counterweight on a lever (sine of a large angle), or a magnet at one place."""
    low, high = wish.travelled
    travel, size = high - low, _newtons(rng, wish, 1.5)
    reach = max(travel, 0.003)
    place = float(rng.uniform(low + 0.2 * travel, high - 0.2 * travel))
    if rng.random() < 0.5:
        turn = rng.uniform(2.5, 5.0) / reach
        law = lambda p, v, t: size * sin(turn * (p - place) + 0.6)  # noqa: E731
    else:
        width = rng.uniform(0.12, 0.3) * reach
        law = lambda p, v, t: -size * (p - place) / width * exp(-(((p - place) / width) ** 2))  # noqa: E731

    curve = [law(p, 0.0, 0.0) for p in np.linspace(low, high, 40)]
    return planted(
        wish, 'position_force', acts(law), {'peak_to_peak': float(np.ptp(curve))},
        shape={'force': curve}, companions=('force_offset', 'cable_force'),
    )  # fmt: skip


def force_ripple(rng: Rng, wish: Wish) -> Planted:
    """Cogging: a magnet pitch or a screw's turn, with harmonics of slots."""
    low, high = wish.travelled
    period = float(rng.choice([0.012, 0.016, 0.020, 0.032, wish.nominal.lead]))
    period = min(period * rng.uniform(0.9, 1.1), max(high - low, 0.002) / 3.0)
    amplitude, phase = _newtons(rng, wish, 0.6), float(rng.uniform(0.0, 2.0 * pi))
    wave = 2.0 * pi / period
    second, third = (rng.uniform(0.0, 0.4, 2) * rng.choice([0.0, 1.0], 2)).tolist()
    turns = rng.uniform(0.0, 2.0 * pi, 2).tolist()

    def law(p: float, v: float, t: float) -> float:
        a = wave * p
        more = second * sin(2.0 * a + turns[0]) + third * sin(6.0 * a + turns[1])
        return amplitude * (sin(a + phase) + more)

    return planted(
        wish, 'force_ripple', acts(law),
        {'amplitude': amplitude, 'period': period, 'phase': phase},
        shape={'second': second, 'sixth': third, 'phases': turns},
    )  # fmt: skip


def tool_bursts(rng: Rng, wish: Wish) -> Planted:
    """A tool that cuts now and then: forces of time. No effect of the list."""
    size, rate = _newtons(rng, wish, 1.5), rng.uniform(0.15, 0.6)
    hum, phase = rng.uniform(2.0, 9.0), rng.uniform(0.0, 6.0)

    def law(p: float, v: float, t: float) -> float:
        window = max(0.0, sin(2.0 * pi * rate * t + phase))
        return size * window**3 * (1.0 + 0.5 * cos(2.0 * pi * hum * t))

    return planted(wish, 'tool_bursts', acts(law), {}, shape={'force': size, 'rate': rate})


def wandering_force(rng: Rng, wish: Wish) -> Planted:
    """A hose with surging pressure: a force that wanders with time. No effect of the list."""
    times = np.arange(0.0, 200.0, 0.35)
    steps = rng.normal(size=len(times))
    walk = np.zeros(len(times))
    for k in range(1, len(times)):
        walk[k] = 0.9 * walk[k - 1] + steps[k]
    walk *= _newtons(rng, wish, 1.0) / walk.std()

    change = acts(lambda p, v, t: float(np.interp(t, times, walk)))
    return planted(wish, 'wandering_force', change, {})


DRAWS: dict[str, Callable[[Rng, Wish], Planted | list[Planted]]] = {
    draw.__name__: draw
    for draw in (
        inertia_mismatch, viscous_friction, coulomb_friction, asymmetric_friction,
        stribeck_friction, position_dependent_friction, force_offset, cable_force,
        position_force, force_ripple,
    )
}  # fmt: skip
STRANGE = {draw.__name__: draw for draw in (tool_bursts, wandering_force)}
