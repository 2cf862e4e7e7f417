"""Effects of the drive and of second bodies: controller, amplifier, play, resonances, base."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ..record import Planted, Wish
from .servo_effects import planted_on_axis

Rng = np.random.Generator
GAINS = {
    'position_gain': (0.6, 1.35),
    'velocity_gain': (0.6, 1.3),
    'integral_gain': (0.3, 1.8),
    'filter': (0.5, 1.8),
}


def controller_mismatch(rng: Rng, wish: Wish) -> Planted:
    """One to three gains, or the feed-forward, are not those of the twin file."""
    names = [*GAINS, 'feedforward']
    chosen = [names[i] for i in rng.permutation(5)[: rng.integers(1, 4)]]
    settings: dict[str, Any] = {}
    parameters: dict[str, float] = {}
    nominal = {
        'position_gain': wish.nominal.position_gain, 'velocity_gain': wish.nominal.velocity_gain,
        'integral_gain': wish.nominal.integral_gain, 'filter': wish.nominal.velocity_filter,
    }  # fmt: skip
    for name in chosen:
        if name == 'feedforward':
            now = wish.nominal.velocity_feedforward
            value = rng.uniform(0.6, 1.0) if now < 0.4 else rng.uniform(0.0, 0.5)
            settings['feedforward'] = parameters['velocity_feedforward'] = float(value)
            continue
        low, high = GAINS[name]
        factor = float(rng.uniform(low, 0.85) if rng.random() < 0.5 else rng.uniform(1.15, high))
        settings[name + '*'] = factor
        parameters['velocity_filter' if name == 'filter' else name] = nominal[name] * factor
    return planted_on_axis(wish, 'controller_mismatch', settings, parameters)


def drive_gain(rng: Rng, wish: Wish) -> Planted:
    """The motor gives another force than commanded."""
    gain = max(0.4, 1.0 + wish.size * rng.uniform(0.08, 0.3) * rng.choice([-1.0, 1.0]))
    # Alone, on a plant whose viscous force is small, a force scale is a mass scale.
    blunt = wish.nominal.viscous * wish.speeds[0] < 0.03 * wish.forces[0]
    return planted_on_axis(
        wish,
        'drive_gain',
        {'gain': gain},
        {'gain': gain},
        instead=('inertia_mismatch',) if blunt else (),
    )


def force_saturation(rng: Rng, wish: Wish) -> Planted:
    """The amplifier, or in half of the cases the controller itself, clips below the file's limit.

    At 0.35 to 0.85 of the force that the path needs, so that it clips now and then.
    """
    peak = min(wish.forces[1], wish.nominal.force_limit)
    limit = peak * float(np.clip(rng.uniform(0.45, 0.85) / wish.size**0.5, 0.3, 0.85))
    place = 'clip' if rng.random() < 0.6 else 'limit'
    settings = {place: limit}
    return planted_on_axis(
        wish, 'force_saturation', settings, {'limit': limit}, shape={'place': place}
    )


def actuation_delay(rng: Rng, wish: Wish) -> Planted:
    """Dead time between command and force."""
    delay = float(min(0.004, wish.size * rng.uniform(0.0004, 0.0018)))
    return planted_on_axis(wish, 'actuation_delay', {'delay': delay}, {'delay': delay})


def current_loop_lag(rng: Rng, wish: Wish) -> Planted:
    """First-order lag of the force."""
    lag = float(min(0.005, wish.size * rng.uniform(0.0005, 0.002)))
    return planted_on_axis(wish, 'current_loop_lag', {'lag': lag}, {'time_constant': lag})


def torque_sag(rng: Rng, wish: Wish) -> Planted:
    """The force constant falls with force (saturated iron), speed (voltage) or heat (magnets)."""
    sag = min(0.6, wish.size * rng.uniform(0.1, 0.3))
    kind = str(rng.choice(['force', 'speed', 'heat']))
    settings: dict[str, float]
    if kind == 'force':
        settings = {'sag_force': sag / max(wish.forces[1], 1.0)}
    elif kind == 'speed':
        settings = {'sag_speed': sag / max(wish.speeds[1], 1e-3)}
    else:
        settings = {'sag_heat': sag, 'heat_time': rng.uniform(5.0, 30.0)}
    parameters = {k: float(v) for k, v in settings.items() if k != 'heat_time'}
    return planted_on_axis(
        wish, 'torque_sag', settings, parameters, shape={'with': kind, 'sag': sag}
    )


def structural_resonance(rng: Rng, wish: Wish) -> Planted:
    """Part of the mass on a spring behind the encoder; the tracker sees that part or the carriage.

    `frequency` is the pole (both bodies free), `antiresonance` the zero seen at the encoder.
    """
    share = float(np.clip(wish.size, 1.0, 2.0) * rng.uniform(0.08, 0.3))
    bandwidth = wish.nominal.velocity_gain / wish.nominal.mass / (2.0 * np.pi)
    frequency = float(bandwidth * rng.uniform(0.5, 3.0) / min(wish.size, 3.0) ** 0.5)
    damping = float(rng.uniform(0.01, 0.06))
    load = share * wish.nominal.mass
    antiresonance = frequency * np.sqrt(1.0 - share)
    omega = 2.0 * np.pi * antiresonance
    settings = {
        'load': load, 'load_stiffness': load * omega**2,
        'load_damping': 2.0 * damping * load * omega,
    }  # fmt: skip
    seen = bool(rng.random() < 0.5)
    planted = planted_on_axis(
        wish,
        'structural_resonance',
        settings,
        {'frequency': frequency, 'antiresonance': antiresonance, 'mass_ratio': share},
        shape={'tracker_sees_load': seen, 'load_damping_ratio': damping},
        instead=() if seen else ('base_resonance',),
    )
    planted.settings['sees_load'] = {wish.letter: seen}
    return planted


def drive_play(rng: Rng, wish: Wish) -> Planted:
    """Play between the motor's inertia and the carriage with the encoder."""
    width = float(wish.size * np.exp(rng.uniform(np.log(3e-6), np.log(6e-5))))
    share = rng.uniform(0.1, 0.4)
    mass = share * wish.nominal.mass
    reduced = mass * (1.0 - share)
    omega = 2.0 * np.pi * rng.uniform(250.0, 450.0)
    settings = {
        'drive_mass': mass, 'play': width, 'play_stiffness': reduced * omega**2,
        'play_damping': 2.0 * rng.uniform(0.1, 0.4) * reduced * omega,
    }  # fmt: skip
    # A carriage without any friction would coast through its play; guides have some.
    level = rng.uniform(0.02, 0.08) * wish.nominal.mass
    settings |= {'coulomb': np.array([level, level]), 'presliding': 2e-6}
    return planted_on_axis(
        wish,
        'drive_play',
        settings,
        {'width': width},
        shape={'drive_mass': mass, 'carriage_friction': level},
        companions=('coulomb_friction',),
    )


def base_resonance(rng: Rng, wish: Wish) -> Planted:
    """The base stands on soft mounts; a tracker on the floor sees it move, one on it does not."""
    mass = wish.nominal.mass * rng.uniform(3.0, 15.0) / wish.size
    frequency, damping = rng.uniform(6.0, 30.0), rng.uniform(0.02, 0.1)
    omega = 2.0 * np.pi * frequency
    settings = {
        'base': mass, 'base_stiffness': mass * omega**2,
        'base_damping': 2.0 * damping * mass * omega,
    }  # fmt: skip
    seen = bool(rng.random() < 0.5)
    planted = planted_on_axis(
        wish,
        'base_resonance',
        settings,
        {'frequency': frequency, 'damping': damping, 'mass': mass},
        shape={'tracker_on_floor': seen},
        instead=('structural_resonance',),
    )
    planted.settings['sees_base'] = {wish.letter: seen}
    return planted


def floor_vibration(rng: Rng, wish: Wish) -> Planted:
    """A neighbour's engine: forces of time, at two or three frequencies. No effect of the list."""
    level = wish.size * wish.nominal.mass * rng.uniform(0.1, 0.4)
    lines = [
        [level * rng.uniform(0.4, 1.0), 2.0 * np.pi * rng.uniform(0.7, 18.0), rng.uniform(0, 6.28)]
        for _ in range(rng.integers(2, 4))
    ]
    return planted_on_axis(
        wish, 'floor_vibration', {'shake+': np.array(lines)}, {}, shape={'lines': lines}
    )


DRAWS: dict[str, Callable[[Rng, Wish], Planted]] = {
    draw.__name__: draw
    for draw in (
        controller_mismatch, drive_gain, force_saturation, actuation_delay, current_loop_lag,
        torque_sag, structural_resonance, drive_play, base_resonance,
    )
}  # fmt: skip
