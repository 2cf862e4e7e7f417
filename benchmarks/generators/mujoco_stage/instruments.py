"""Effects of table, tracker, encoder and recorder, by the geometry of bodies and signals."""

from __future__ import annotations

from collections.abc import Callable
from math import atan2, cos, pi, sin
from typing import Any

import numpy as np

from ..record import Planted, Wish
from .plan import Array, AxisPlan, StagePlan

Rng = np.random.Generator


def _stage(
    wish: Wish,
    effect: str,
    change: Callable[[StagePlan], None],
    parameters: dict[str, float],
    **more: Any,
) -> Planted:
    values = {key: float(value) for key, value in parameters.items()}
    axis = None if effect in GLOBAL else wish.letter
    return Planted(effect, axis, values, settings={'change': change}, **more)


def _table(
    wish: Wish, effect: str, law: Callable[[Array], Array], to: int, **more: Any
) -> Planted:
    """A displacement of coordinate `to` by a law of the motor positions (m, 2)."""

    def displacement(p: Array, t: Array) -> Array:
        out = np.zeros_like(p)
        out[:, to] = law(p)
        return out

    parameters = more.pop('parameters', {})
    return _stage(wish, effect, lambda plan: plan.tables.append(displacement), parameters, **more)


def _reach(wish: Wish) -> tuple[float, float]:
    """Middle and half length of the travelled range [m]."""
    low, high = wish.travelled
    return 0.5 * (low + high), 0.5 * max(high - low, 0.003)


def _signed(rng: Rng, wish: Wish, low: float, high: float) -> float:
    return float(wish.size * rng.uniform(low, high) * rng.choice([-1.0, 1.0]))


def scale_error(rng: Rng, wish: Wish) -> Planted:
    """p · (1 + e)."""
    e, axis = _signed(rng, wish, 5e-5, 5e-4), wish.axis
    return _table(wish, 'scale_error', lambda p: e * p[:, axis], axis, parameters={'scale': e})


def cyclic_pitch_error(rng: Rng, wish: Wish) -> Planted:
    """A screw that runs out, a wobbling coupling: one wave a turn, of its own turn length."""
    axis, amplitude = wish.axis, abs(_signed(rng, wish, 2e-6, 1e-5))
    period = float(rng.choice([1.0, 1.0, 0.5, 0.37, 1.25]) * wish.nominal.lead)
    period = min(period, 2.0 * _reach(wish)[1] / 3.0)
    phase, other = rng.uniform(0.0, 2.0 * pi, 2)
    second = float(rng.choice([0.0, rng.uniform(0.1, 0.4)]))

    def law(p: Array) -> Array:
        turn = 2.0 * pi * p[:, axis] / period
        return amplitude * (np.sin(turn + phase) + second * np.sin(2.0 * turn + other))

    values = {'amplitude': amplitude, 'period': period, 'phase': float(phase)}
    return _table(wish, 'cyclic_pitch_error', law, axis, parameters=values,
                  shape={'second': second})  # fmt: skip


def nonorthogonality(rng: Rng, wish: Wish) -> Planted:
    """The y slide leans: its points are (−sin φ, cos φ) · y."""
    angle = _signed(rng, wish, 3e-5, 4e-4)

    def displacement(p: Array, t: Array) -> Array:
        return p[:, 1:] * np.array([-sin(angle), cos(angle) - 1.0])

    return _stage(wish, 'nonorthogonality', lambda plan: plan.tables.append(displacement),
                  {'angle': angle})  # fmt: skip


def _rail(rng: Rng, wish: Wish) -> Callable[[Array], Array]:
    """A rail's bend, peak about 1: a bow, a kink at a joint of two rails, waves of its screws."""
    middle, half = _reach(wish)
    bow, kink, wave = rng.normal(size=3) * np.array([1.0, 0.7, 0.4])
    place, width = rng.uniform(-0.6, 0.6), rng.uniform(0.15, 0.4)
    pitch, phase = rng.uniform(0.5, 1.1), rng.uniform(0.0, 2.0 * pi)

    def curve(p: Array) -> Array:
        s = (p - middle) / half
        bend = bow * s**2 + kink * np.tanh((s - place) / width)
        return np.asarray(bend + wave * np.sin(2.0 * pi * s / pitch + phase))

    grid = np.linspace(middle - half, middle + half, 300)
    slope, level = np.polyfit(grid, curve(grid), 1)
    peak = np.abs(curve(grid) - slope * grid - level).max()
    return lambda p: (curve(p) - slope * p - level) / peak


def straightness(rng: Rng, wish: Wish) -> Planted:
    """The rail's bend moves the other coordinate."""
    axis, peak, rail = wish.axis, abs(_signed(rng, wish, 2e-6, 1.5e-5)), _rail(rng, wish)
    return _table(wish, 'straightness', lambda p: peak * rail(p[:, axis]), 1 - axis,
                  shape={'peak': peak})  # fmt: skip


def angular_error(rng: Rng, wish: Wish) -> Planted:
    """Yaw of the carriage moves the reflector at the end of an arm."""
    axis, peak, rail = wish.axis, abs(_signed(rng, wish, 3e-5, 2.5e-4)), _rail(rng, wish)
    arm, sign = float(rng.uniform(-0.2, 0.2)), -1.0 if wish.axis == 0 else 1.0

    def law(p: Array) -> Array:
        return np.asarray(sign * np.sin(peak * rail(p[:, axis])) * (p[:, 1 - axis] + arm))

    return _table(wish, 'angular_error', law, axis, parameters={'arm': arm},
                  shape={'peak': peak})  # fmt: skip


def _on_axis(wish: Wish, change: Callable[[AxisPlan], None]) -> Callable[[StagePlan], None]:
    return lambda plan: change(plan.axes[wish.axis])


def backlash(rng: Rng, wish: Wish) -> Planted:
    """The table is a body of its own, tied to the carriage by a tendon of limited length."""
    width = abs(_signed(rng, wish, 5e-6, 6e-5))
    change = _on_axis(wish, lambda axis: setattr(axis, 'table_play', width))
    return _stage(wish, 'backlash', change, {'width': width})


def thermal_expansion(rng: Rng, wish: Wish) -> Planted:
    """The nut's friction heats the screw, which loses its heat to the air."""
    axis, alpha = wish.axis, float(rng.uniform(8e-6, 2.3e-5))
    middle, half = _reach(wish)
    fixed = float(rng.choice([middle - 2.0 * half, middle + 3.0 * half, middle - half - 0.1]))
    rise, tau = float(wish.size * rng.uniform(1.5, 5.0)), float(rng.uniform(10.0, 60.0))
    start = float(rng.uniform(-1.0, 1.5))

    def change(plan: StagePlan) -> None:
        plan.expansion.append((axis, alpha, fixed, rise, tau))
        plan.expansion.append((axis, 0.0, fixed, start, -1.0))

    return _stage(wish, 'thermal_expansion', change, {'alpha': alpha, 'fixed': fixed},
                  shape={'rise': rise, 'time_constant': tau})  # fmt: skip


def tracker_misalignment(rng: Rng, wish: Wish) -> Planted:
    """The tracker's frame is turned, and shifted in half of the cases."""
    angle = _signed(rng, wish, 1e-4, 2e-3)
    shift = rng.normal(0.0, 1e-4, 2) * rng.choice([0.0, 1.0])
    frame = (angle, float(shift[0]), float(shift[1]))
    return _stage(wish, 'tracker_misalignment', lambda plan: setattr(plan, 'frame', frame),
                  {'angle': angle, 'offset_x': shift[0], 'offset_y': shift[1]})  # fmt: skip


def tracker_latency(rng: Rng, wish: Wish) -> Planted:
    """The point is older than its stamp."""
    latency = min(0.025, abs(_signed(rng, wish, 5e-4, 1e-2)))
    return _stage(wish, 'tracker_latency', lambda plan: setattr(plan, 'latency', latency),
                  {'latency': latency})  # fmt: skip


def tracker_clock_drift(rng: Rng, wish: Wish) -> Planted:
    """stamp = t · (1 + drift)."""
    drift = _signed(rng, wish, 2e-5, 1.5e-4)
    return _stage(wish, 'tracker_clock_drift', lambda plan: setattr(plan, 'drift', drift),
                  {'drift': drift})  # fmt: skip


def encoder_quantisation(rng: Rng, wish: Wish) -> Planted:
    """Counts that are coarser than the file says."""
    step = float(wish.nominal.encoder_resolution * rng.choice([4, 6, 10, 20]) * np.ceil(wish.size))
    change = _on_axis(wish, lambda axis: setattr(axis, 'resolution', min(step, 2e-5)))
    return _stage(wish, 'encoder_quantisation', change, {'resolution': min(step, 2e-5)})


def encoder_interpolation(rng: Rng, wish: Wish) -> Planted:
    """Sine and cosine of the scale with offset, unequal size and a phase off the right angle."""
    period = float(rng.choice([2e-5, 4e-5, 1e-4, 2e-4, 5e-4]))
    least = 6.0 * pi * wish.nominal.encoder_resolution / period
    offset = min(0.5, wish.size * max(least, rng.uniform(0.02, 0.08)))
    where = float(rng.uniform(0.0, 2.0 * pi))
    gain, lean = (offset * rng.uniform(-0.5, 0.5, 2)).tolist()

    def error(p: float) -> float:
        angle = 2.0 * pi * (p / period - round(p / period))
        a = (1.0 + gain) * cos(angle) + offset * cos(where)
        b = sin(angle + lean) + offset * sin(where)
        off = atan2(b, a) - angle
        return period * (off / (2.0 * pi) - round(off / (2.0 * pi)))

    change = _on_axis(wish, lambda axis: axis.scale_errors.append(error))
    return _stage(wish, 'encoder_interpolation', change,
                  {'amplitude': period * offset / (2.0 * pi), 'period': period},
                  shape={'gain': gain, 'lean': lean})  # fmt: skip


def sample_jitter(rng: Rng, wish: Wish) -> Planted:
    """The recorder stamps what comes in time, off by its own scheduling."""
    noise = float(wish.machine.control_period * rng.uniform(0.08, 0.2))
    return _stage(wish, 'sample_jitter', lambda plan: setattr(plan, 'stamp_noise', noise),
                  {'std': noise})  # fmt: skip


def effort_convention(rng: Rng, wish: Wish) -> list[Planted]:
    """Both drives, or one, record the effort with another sign, as a magnitude or in a unit."""
    kind = str(rng.choice(['sign', 'magnitude', 'amperes', 'percent']))
    factor = {
        'sign': -1.0, 'magnitude': 1.0, 'amperes': 1.0 / float(rng.uniform(8.0, 60.0)),
        'percent': 100.0 / wish.nominal.force_limit,
    }[kind]  # fmt: skip
    axes = (0, 1) if rng.random() < 0.6 else (wish.axis,)

    def written(effort: Array) -> Array:
        out = effort.copy()
        for axis in axes:
            out[:, axis] = factor * (
                np.abs(effort[:, axis]) if kind == 'magnitude' else effort[:, axis]
            )
        return out

    def change(plan: StagePlan) -> None:
        plan.efforts.append(written)

    return [
        Planted('effort_convention', 'xy'[axis], {'factor': factor}, {'convention': kind},
                settings={'change': change} if axis == axes[0] else {})
        for axis in axes
    ]  # fmt: skip


def rattling_reflector(rng: Rng, wish: Wish) -> Planted:
    """A reflector in a loose nest: it slides when the table accelerates. No effect of the list."""
    bound = float(rng.uniform(0.2, 0.6) * max(wish.forces[0] / wish.nominal.mass, 0.02))
    size = abs(_signed(rng, wish, 4e-6, 1.5e-5))
    return _stage(wish, 'rattling_reflector', lambda plan: setattr(plan, 'rattle', (bound, size)),
                  {}, shape={'acceleration': bound, 'size': size})  # fmt: skip


GLOBAL = (
    'nonorthogonality', 'tracker_misalignment', 'tracker_latency', 'tracker_clock_drift',
    'sample_jitter', 'rattling_reflector',
)  # fmt: skip
DRAWS: dict[str, Callable[[Rng, Wish], Planted | list[Planted]]] = {
    draw.__name__: draw
    for draw in (
        scale_error, cyclic_pitch_error, nonorthogonality, straightness, angular_error, backlash,
        thermal_expansion, tracker_misalignment, tracker_latency, tracker_clock_drift,
        encoder_quantisation, encoder_interpolation, sample_jitter, effort_convention,
    )
}  # fmt: skip
STRANGE = {'rattling_reflector': rattling_reflector}
