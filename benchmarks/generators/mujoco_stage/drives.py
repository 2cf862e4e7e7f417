"""Effects of the drive and of second bodies: actuator, controller, play, resonances, base."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import exp, pi

import numpy as np

from ..record import Planted, Wish
from .model import STEPS
from .plan import AxisPlan, StagePlan
from .servo import planted, sets

Rng = np.random.Generator


def drive_gain(rng: Rng, wish: Wish) -> Planted:
    """Gear of the actuator."""
    gain = max(0.45, 1.0 + wish.size * rng.uniform(0.1, 0.35) * rng.choice([-1.0, 1.0]))
    blunt = wish.nominal.viscous * wish.speeds[0] < 0.03 * wish.forces[0]
    return planted(wish, 'drive_gain', sets(gear=gain), {'gain': gain},
                   instead=('inertia_mismatch',) if blunt else ())  # fmt: skip


def force_saturation(rng: Rng, wish: Wish) -> Planted:
    """Range of the actuator's force below what the path needs at its peaks."""
    limit = wish.forces[1] * float(np.clip(rng.uniform(0.5, 0.85) / wish.size**0.5, 0.3, 0.85))
    own = bool(rng.random() < 0.5)

    def change(axis: AxisPlan) -> None:
        if own:
            axis.controller = replace(axis.controller, force_limit=limit)
        else:
            axis.force_range = limit

    place = 'controller' if own else 'amplifier'
    return planted(wish, 'force_saturation', change, {'limit': limit}, shape={'place': place})


def actuation_delay(rng: Rng, wish: Wish) -> Planted:
    """Dead time of whole physics steps."""
    period = wish.machine.control_period
    step = period / STEPS[period]
    delay = step * round(min(0.004, wish.size * rng.uniform(0.0005, 0.002)) / step)
    return planted(wish, 'actuation_delay', sets(delay=delay), {'delay': delay})


def current_loop_lag(rng: Rng, wish: Wish) -> Planted:
    """A filter in the actuator."""
    lag = min(0.005, wish.size * rng.uniform(0.0006, 0.002))
    return planted(wish, 'current_loop_lag', sets(lag=lag), {'time_constant': lag})


def torque_sag(rng: Rng, wish: Wish) -> Planted:
    """The force factor falls with force (quadratically), with speed or with time."""
    sag = min(0.6, wish.size * rng.uniform(0.12, 0.3))
    peak, fast = max(wish.forces[1], 1.0), max(wish.speeds[1], 1e-3)
    tau = rng.uniform(6.0, 25.0)
    kind = str(rng.choice(['force', 'speed', 'time']))
    laws = {
        'force': lambda f, v, t: 1.0 - sag * min(1.5, (f / peak) ** 2),
        'speed': lambda f, v, t: 1.0 - sag * min(1.5, abs(v) / fast),
        'time': lambda f, v, t: 1.0 - sag * (1.0 - exp(-t / tau)),
    }
    return planted(wish, 'torque_sag', sets(sag=laws[kind]), {},
                   shape={'with': kind, 'sag': sag, 'time_constant': tau})  # fmt: skip


def controller_mismatch(rng: Rng, wish: Wish) -> Planted:
    """Somebody has tuned the loop since: one gain, two, or the feed-forward."""
    names = ['position_gain', 'velocity_gain', 'integral_gain', 'velocity_filter']
    chosen = [names[i] for i in rng.permutation(4)[: rng.integers(1, 3)]]
    values = {
        name: float(getattr(wish.nominal, name) * rng.choice([0.55, 0.7, 0.8, 1.2, 1.3]))
        for name in chosen
    }
    if rng.random() < 0.25:
        now = wish.nominal.velocity_feedforward
        values = {'velocity_feedforward': 1.0 if now < 0.5 else 0.0}

    def change(axis: AxisPlan) -> None:
        axis.controller = replace(axis.controller, **values)

    return planted(wish, 'controller_mismatch', change, values)


def structural_resonance(rng: Rng, wish: Wish) -> Planted:
    """A child body on a joint spring; the reflector sits on it or on the carriage."""
    share = float(rng.uniform(0.1, 0.35) * min(wish.size, 2.0) ** 0.5)
    loop = wish.nominal.velocity_gain / wish.nominal.mass / (2.0 * pi)
    zero = float(loop * rng.uniform(0.5, 2.5) / min(wish.size, 3.0) ** 0.5)
    pole, ratio = zero / np.sqrt(1.0 - share), float(rng.uniform(0.01, 0.05))
    load, omega = share * wish.nominal.mass, 2.0 * pi * zero
    seen = bool(rng.random() < 0.5)
    change = sets(load=(load, load * omega**2, 2.0 * ratio * load * omega), sees_load=seen)
    return planted(
        wish, 'structural_resonance', change,
        {'frequency': pole, 'antiresonance': zero, 'mass_ratio': share},
        shape={'tracker_sees_load': seen, 'load_damping_ratio': ratio},
        instead=() if seen else ('base_resonance',),
    )  # fmt: skip


def drive_play(rng: Rng, wish: Wish) -> Planted:
    """A motor body and the carriage, tied by a tendon of limited length; the guide rubs a bit."""
    width = float(wish.size * rng.uniform(5e-6, 6e-5))
    motor = float(rng.uniform(0.1, 0.35) * wish.nominal.mass)
    level = 0.05 * wish.nominal.mass
    change = sets(drive=(motor, width), friction=lambda p, v, t: level)
    return planted(wish, 'drive_play', change, {'width': width},
                   shape={'drive_mass': motor, 'carriage_friction': level},
                   companions=('coulomb_friction',))  # fmt: skip


def base_resonance(rng: Rng, wish: Wish) -> Planted:
    """The slide stands on a base with a joint spring to the floor."""
    mass = wish.nominal.mass * rng.uniform(4.0, 15.0) / wish.size
    frequency, ratio = float(rng.uniform(5.0, 25.0)), float(rng.uniform(0.02, 0.1))
    omega, seen = 2.0 * pi * frequency, bool(rng.random() < 0.5)
    change = sets(base=(mass, mass * omega**2, 2.0 * ratio * mass * omega), sees_base=seen)
    # The mounts carry base and carriage together.
    carried = frequency * np.sqrt(mass / (mass + wish.nominal.mass))
    return planted(
        wish, 'base_resonance', change, {'frequency': frequency, 'damping': ratio, 'mass': mass},
        shape={'tracker_on_floor': seen, 'frequency_carried': carried},
        instead=('structural_resonance',),
    )  # fmt: skip


def axis_crosstalk(rng: Rng, wish: Wish) -> list[Planted]:
    """The inner slide leans on the outer one: each feels the other's acceleration.

    M = [[m_x, c], [c, m_y]] with c = (mass that rides on both) · (sine of the lean). An axis that
    this moves far less than the other is named only as a companion.
    """
    x, y = wish.machine.axes
    lean = float(np.clip(wish.size * rng.uniform(0.1, 0.3), 0.0, 0.7) * rng.choice([-1.0, 1.0]))
    riding = 0.5 * min(x.mass, y.mass)
    coupling = lean * riding

    def change(plan: StagePlan) -> None:
        plan.skew, plan.riding = lean, riding

    acceleration = np.std(np.gradient(wish.reference.velocity, axis=0), axis=0)
    softness = [1.0 / (axis.position_gain * axis.velocity_gain) for axis in (x, y)]
    strength = [acceleration[1] * softness[0], acceleration[0] * softness[1]]
    strong = int(strength[1] > strength[0])
    both = min(strength) > 0.3 * max(strength)
    out = [
        Planted('axis_crosstalk', 'xy'[strong], {'mass': coupling}, {'lean': lean},
                companions=() if both else (f'axis_crosstalk.{"yx"[strong]}',),
                settings={'change': change})
    ]  # fmt: skip
    if both:
        out.append(Planted('axis_crosstalk', 'yx'[strong], {'mass': coupling}))
    return out


DRAWS: dict[str, Callable[[Rng, Wish], Planted | list[Planted]]] = {
    draw.__name__: draw
    for draw in (
        drive_gain, force_saturation, actuation_delay, current_loop_lag, torque_sag,
        controller_mismatch, structural_resonance, drive_play, base_resonance, axis_crosstalk,
    )
}  # fmt: skip
