"""Effects between encoder and table and of the sensors.

Settings: `table` holds functions of (positions (n, 2), temperatures of the screws above the
reference (n, 2), times (n,)) that return displacements (n, 2) [m]; they see a fine time grid.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numba import njit
from scipy.interpolate import CubicSpline
from scipy.signal import lfilter

from ..record import Planted, Wish

Rng = np.random.Generator
Array = np.ndarray
Displacement = Callable[[Array, Array, Array], Array]
EXPANSION = 11.5e-6


def _planted(
    wish: Wish,
    effect: str,
    settings: dict[str, Any],
    parameters: dict[str, float],
    **more: Any,
) -> Planted:
    numbers = {k: float(v) for k, v in parameters.items()}
    axis = None if effect in GLOBAL else wish.letter
    return Planted(effect, axis, numbers, settings=settings, **more)


def _along(axis: int, values: Array) -> Array:
    out = np.zeros((len(values), 2))
    out[:, axis] = values
    return out


def _spread(wish: Wish, axis: int) -> float:
    return float(max(np.ptp(wish.reference.position[:, axis]), 0.002))


def _error(rng: Rng, wish: Wish, low: float, high: float) -> float:
    """A length error [m], logarithmic between the bounds."""
    return float(wish.size * np.exp(rng.uniform(np.log(low), np.log(high))))


def scale_error(rng: Rng, wish: Wish) -> Planted:
    """A screw or scale of another pitch."""
    axis, e = wish.axis, _error(rng, wish, 4e-5, 6e-4) * rng.choice([-1.0, 1.0])
    table: Displacement = lambda p, warm, t: _along(axis, e * p[:, axis])  # noqa: E731
    return _planted(wish, 'scale_error', {'table': [table]}, {'scale': e})


def cyclic_pitch_error(rng: Rng, wish: Wish) -> Planted:
    """Waves of the screw or the coupling, with a period of their own and up to two harmonics."""
    axis, lead = wish.axis, wish.nominal.lead
    period = float(rng.choice([lead, lead, lead / 2, lead * rng.uniform(0.3, 1.8)]))
    period = min(period, _spread(wish, axis) / 2.5)
    amplitude = _error(rng, wish, 2e-6, 1.2e-5)
    rows = [(amplitude, 1, rng.uniform(0.0, 2.0 * np.pi))]
    for order in rng.permutation([2, 3])[: rng.integers(0, 3)]:
        size = amplitude * rng.uniform(0.08, 0.4)
        rows.append((size, int(order), rng.uniform(0.0, 2.0 * np.pi)))

    def table(p: Array, warm: Array, t: Array) -> Array:
        angle = 2.0 * np.pi * p[:, axis] / period
        return _along(
            axis, np.sum([a * np.sin(n * angle + phase) for a, n, phase in rows], axis=0)
        )

    return _planted(
        wish,
        'cyclic_pitch_error',
        {'table': [table]},
        {'amplitude': amplitude, 'period': period, 'phase': rows[0][2]},
        shape={'harmonics': [list(map(float, row)) for row in rows]},
    )


def nonorthogonality(rng: Rng, wish: Wish) -> Planted:
    """The y axis leans by an angle: x_t = x − sin φ · y, y_t = cos φ · y."""
    angle = _error(rng, wish, 2e-5, 4e-4) * rng.choice([-1.0, 1.0])

    def table(p: Array, warm: Array, t: Array) -> Array:
        y = p[:, 1]
        return np.column_stack([-np.sin(angle) * y, (np.cos(angle) - 1.0) * y])

    return _planted(wish, 'nonorthogonality', {'table': [table]}, {'angle': angle})


def _guide(rng: Rng, wish: Wish) -> CubicSpline:
    """A smooth curve through random heights along the travelled range, its line removed."""
    low, high = wish.travelled
    reach = max(high - low, 0.002)
    knots = np.linspace(low - 0.2 * reach, high + 0.2 * reach, int(rng.integers(5, 9)))
    walk = np.cumsum(rng.normal(size=len(knots)))
    curve = CubicSpline(knots, walk)
    grid = np.linspace(low, low + reach, 400)
    line = np.polyfit(grid, curve(grid), 1)
    peak = np.max(np.abs(curve(grid) - np.polyval(line, grid)))
    return CubicSpline(knots, (walk - np.polyval(line, knots)) / peak)


def straightness(rng: Rng, wish: Wish) -> Planted:
    """A bent guide displaces the other coordinate along any smooth curve."""
    axis, curve = wish.axis, _guide(rng, wish)
    peak = _error(rng, wish, 2e-6, 2e-5)
    table: Displacement = lambda p, warm, t: _along(1 - axis, peak * curve(p[:, axis]))  # noqa: E731
    return _planted(wish, 'straightness', {'table': [table]}, {}, shape=_curve(curve, peak))


def angular_error(rng: Rng, wish: Wish) -> Planted:
    """Yaw a(p) of a bent guide, at an arm: x by −a·(y + arm), y by +a·(x + arm)."""
    axis, curve = wish.axis, _guide(rng, wish)
    peak, arm = _error(rng, wish, 3e-5, 3e-4), rng.uniform(-0.15, 0.15)
    # Most yaw grows steadily along a guide that sags.
    slope = rng.uniform(-1.0, 1.0) * 1.5 / max(_spread(wish, axis), 0.01)
    centre = float(np.mean(wish.travelled))
    sign = -1.0 if axis == 0 else 1.0

    def table(p: Array, warm: Array, t: Array) -> Array:
        yaw = peak * (curve(p[:, axis]) + slope * (p[:, axis] - centre))
        return _along(axis, sign * yaw * (p[:, 1 - axis] + arm))

    return _planted(
        wish, 'angular_error', {'table': [table]}, {'arm': arm},
        shape=_curve(curve, peak) | {'slope': slope * peak, 'centre': centre},
        companions=('scale_error',),
    )  # fmt: skip


def _curve(curve: CubicSpline, peak: float) -> dict[str, Any]:
    return {'knots': curve.x.tolist(), 'values': (peak * curve(curve.x)).tolist(), 'peak': peak}


@njit(cache=True)
def plays(positions: Array, halves: Array, shares: Array) -> Array:
    """Mean of several plays, each centred at the start: the flanks touch one after another."""
    out = np.zeros(len(positions))
    for i in range(len(halves)):
        at = positions[0]
        for k in range(len(positions)):
            at = min(max(at, positions[k] - halves[i]), positions[k] + halves[i])
            out[k] += shares[i] * at
    return out


def backlash(rng: Rng, wish: Wish) -> Planted:
    """Play after the encoder whose edge is soft: the flanks' widths spread by some per cent."""
    axis, width = wish.axis, _error(rng, wish, 4e-6, 6e-5)
    spread = rng.uniform(0.02, 0.25)
    halves = 0.5 * width * (1.0 + spread * np.linspace(-1.0, 1.0, 9))
    shares = np.full(9, 1.0 / 9.0)

    def table(p: Array, warm: Array, t: Array) -> Array:
        return _along(axis, plays(p[:, axis].copy(), halves, shares) - p[:, axis])

    return _planted(wish, 'backlash', {'table': [table]}, {'width': width},
                    shape={'edge_spread': spread})  # fmt: skip


def thermal_expansion(rng: Rng, wish: Wish) -> Planted:
    """A screw that warms up, with one or two time constants."""
    axis = wish.axis
    alpha = EXPANSION * rng.uniform(0.7, 2.0)
    rise = wish.size * rng.uniform(1.0, 4.0) * rng.choice([-1.0, 1.0, 1.0])
    low, high = wish.travelled
    fixed = float(rng.choice([low - 0.05, high + 0.1, rng.uniform(low - 0.3, high + 0.3)]))
    fast, slow = rng.uniform(8.0, 25.0), rng.uniform(50.0, 200.0)
    share = float(rng.choice([1.0, rng.uniform(0.3, 0.7)]))
    start = float(rng.uniform(-1.5, 1.5))

    def warming(t: Array) -> Array:
        return start + rise * (
            share * (1.0 - np.exp(-t / fast)) + (1.0 - share) * (1.0 - np.exp(-t / slow))
        )

    def table(p: Array, warm: Array, t: Array) -> Array:
        return _along(axis, alpha * warm[:, axis] * (p[:, axis] - fixed))

    return _planted(
        wish, 'thermal_expansion', {'table': [table], 'warming': {axis: warming}},
        {'alpha': alpha, 'fixed': fixed}, shape={'rise': rise, 'time_constants': [fast, slow]},
    )  # fmt: skip


def tracker_misalignment(rng: Rng, wish: Wish) -> Planted:
    """The tracker's frame is turned about the stage's, and shifted."""
    angle = _error(rng, wish, 5e-5, 2e-3) * rng.choice([-1.0, 1.0])
    offset = rng.uniform(-1.0, 1.0, 2) * rng.choice([0.0, 2e-5, 1e-3])
    parameters = {'angle': angle, 'offset_x': offset[0], 'offset_y': offset[1]}
    return _planted(wish, 'tracker_misalignment', {'frame': parameters}, parameters)


def tracker_latency(rng: Rng, wish: Wish) -> Planted:
    """Points older than their stamps, by no whole number of ticks."""
    latency = float(min(0.03, _error(rng, wish, 4e-4, 1.2e-2)))
    return _planted(wish, 'tracker_latency', {'latency': latency}, {'latency': latency})


def tracker_clock_drift(rng: Rng, wish: Wish) -> Planted:
    """stamp = t · (1 + drift)."""
    drift = _error(rng, wish, 1e-5, 1.5e-4) * rng.choice([-1.0, 1.0])
    return _planted(wish, 'tracker_clock_drift', {'drift': drift}, {'drift': drift})


def encoder_quantisation(rng: Rng, wish: Wish) -> Planted:
    """An encoder several times coarser than the file says."""
    factor = float(rng.choice([4, 5, 8, 10, 16])) * np.ceil(wish.size)
    resolution = min(factor * wish.nominal.encoder_resolution, 2e-5)
    settings = {wish.letter: {'resolution': resolution}}
    return _planted(wish, 'encoder_quantisation', settings, {'resolution': resolution})


def encoder_interpolation(rng: Rng, wish: Wish) -> Planted:
    """Waves within one signal period of the scale: offset (first) and gain (second harmonic)."""
    period = float(rng.choice([2e-5, 4e-5, 1e-4, 2e-4, 5e-4]))
    step = wish.nominal.encoder_resolution
    amplitude = wish.size * max(3.0 * step, period * rng.uniform(0.003, 0.012))
    rows = [[amplitude, 2.0 * np.pi / period, rng.uniform(0.0, 2.0 * np.pi)]]
    if rng.random() < 0.6:
        size = amplitude * rng.uniform(0.2, 0.8)
        rows.append([size, 4.0 * np.pi / period, rng.uniform(0.0, 2.0 * np.pi)])
    settings = {wish.letter: {'wave+': np.array(rows)}}
    parameters = {'amplitude': amplitude, 'period': period}
    return _planted(wish, 'encoder_interpolation', settings, parameters, shape={'waves': rows})


def sample_jitter(rng: Rng, wish: Wish) -> Planted:
    """The loop runs off its grid, and stamps the grid."""
    jitter = float(wish.machine.control_period * rng.uniform(0.08, 0.2) * min(wish.size, 1.5))
    return _planted(wish, 'sample_jitter', {'jitter': jitter}, {'std': jitter})


def effort_convention(rng: Rng, wish: Wish) -> Planted:
    """The recorded effort is in another unit, of the other sign, or a magnitude."""
    lead = wish.nominal.lead
    kind = str(rng.choice(['sign', 'magnitude', 'torque', 'counts', 'per_mille']))
    factors = {
        'sign': -1.0, 'magnitude': 1.0, 'torque': lead / (2.0 * np.pi),
        'counts': 32767.0 / wish.nominal.force_limit,
        'per_mille': 1000.0 / wish.nominal.force_limit,
    }  # fmt: skip
    settings = {'effort': {wish.axis: (factors[kind], kind == 'magnitude')}}
    return _planted(wish, 'effort_convention', settings, {'factor': factors[kind]},
                    shape={'convention': kind})  # fmt: skip


def drifting_mount(rng: Rng, wish: Wish) -> Planted:
    """The tracker's stand wanders: a random walk of time. No effect of the list."""
    size, seed = _error(rng, wish, 3e-6, 1.5e-5), int(rng.integers(2**31))

    def table(p: Array, warm: Array, t: Array) -> Array:
        steps = np.random.default_rng(seed).normal(size=(2, 26)).cumsum(axis=1)
        return size * CubicSpline(np.linspace(0.0, t[-1], 26), steps.T)(t)

    return _planted(wish, 'drifting_mount', {'table': [table]}, {}, shape={'step': size})


def relaxing_table(rng: Rng, wish: Wish) -> Planted:
    """A viscoelastic joint: the table creeps after each acceleration. No effect of the list."""
    axis, tau = wish.axis, rng.uniform(0.4, 3.0)
    size = _error(rng, wish, 3e-6, 1.5e-5)

    def table(p: Array, warm: Array, t: Array) -> Array:
        step = float(t[1] - t[0])
        speed = np.gradient(p[:, axis], step)
        pole = np.exp(-step / tau)
        crept = lfilter([1.0 - pole], [1.0, -pole], np.abs(speed))
        return _along(axis, size * crept / max(float(np.max(np.abs(crept))), 1e-12))

    return _planted(wish, 'relaxing_table', {'table': [table]}, {}, shape={'time_constant': tau})


def slipping_scale(rng: Rng, wish: Wish) -> Planted:
    """The reflector's nest slips now and then by some micrometres. No effect of the list."""
    count, size = int(rng.integers(3, 7)), _error(rng, wish, 4e-6, 2e-5)
    seconds = len(wish.reference.position) * wish.machine.control_period
    times = np.sort(rng.uniform(0.1, 0.95, count)) * seconds
    jumps = rng.normal(size=(count, 2)) * size

    def table(p: Array, warm: Array, t: Array) -> Array:
        return np.asarray((t[:, None] >= times).astype(float) @ jumps)

    return _planted(
        wish, 'slipping_scale', {'table': [table]}, {}, shape={'times': times.tolist()}
    )


GLOBAL = (
    'nonorthogonality', 'tracker_misalignment', 'tracker_latency', 'tracker_clock_drift',
    'sample_jitter', 'drifting_mount', 'slipping_scale',
)  # fmt: skip
DRAWS: dict[str, Callable[[Rng, Wish], Planted]] = {
    draw.__name__: draw
    for draw in (
        scale_error, cyclic_pitch_error, nonorthogonality, straightness, angular_error, backlash,
        thermal_expansion, tracker_misalignment, tracker_latency, tracker_clock_drift,
        encoder_quantisation, encoder_interpolation, sample_jitter, effort_convention,
    )
}  # fmt: skip
STRANGE: dict[str, Callable[[Rng, Wish], Planted]] = {
    draw.__name__: draw for draw in (drifting_mount, relaxing_table, slipping_scale)
}
