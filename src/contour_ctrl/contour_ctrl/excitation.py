"""A reference for identification: reversals at several speeds, micro-motion, a multi-sine."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from contour_ctrl.feedrate import AxisLimits, SCurve
from contour_ctrl.reference import Reference
from contour_ctrl.timed import free_motion
from stage_core.arrays import Array
from stage_core.errors import StageError

#: Pauses between moves, so that stiction shows [s].
PAUSE = 0.1
#: Acceleration [m/s^2] and jerk [m/s^3] of the moves.
RAMP = 1.0, 50.0
#: Fade of the sines at both ends [s].
FADE = 0.5
#: Frequencies [Hz] without common multiples below the record's length.
FREQUENCIES = (0.31, 0.67, 1.13, 1.93, 3.17, 5.3, 8.9, 13.7)
#: Of the micro-motion [Hz], and their shares of its range: no two reversals at the same place,
#: so that the rounding to counts averages out.
MICRO_FREQUENCIES = (0.71, 0.71 / 1.618)
MICRO_SHARES = (0.75, 0.25)
#: Where each speed leads, in half ranges: along x, along y, along both diagonals.
CORNERS = (
    *((0, 0), (1, 0), (-1, 0)),
    *((0, 0), (0, 1), (0, -1)),
    *((0, 0), (1, 1), (-1, -1)),
    *((0, 0), (1, -1), (-1, 1), (0, 0)),
)


def excitation(
    half_range: tuple[float, float],
    centre: tuple[float, float] = (0.0, 0.0),
    speeds: Sequence[float] = (0.002, 0.01, 0.04, 0.1),
    multisine_time: float = 10.0,
    period: float = 0.001,
    limits: AxisLimits | None = None,
    seed: int = 0,
    micro_range: float = 6e-5,
    micro_time: float = 15.0,
) -> Reference:
    """Reference from rest to rest at the centre.

    For each speed [m/s]: x alone, y alone, and both diagonals, there and back; the slow speeds
    travel a shorter way, so that each takes about as long as the fastest one or 2 s. Then both
    axes creep to and fro within +-`micro_range` [m] for `micro_time` [s], so slowly that
    presliding shows in the encoder. Then sines of `FREQUENCIES` with random phases (from
    `seed`) on both axes at once for `multisine_time` [s], each component with the same share
    of half the speed, acceleration and travel that the limits allow.

    Raises
    ------
    StageError
        A range, speed or duration that cannot be executed.
    """
    if min(half_range) <= 0.0 or not speeds or min(speeds) <= 0.0:
        raise StageError('the excitation needs positive half_range_x, half_range_y and speeds')
    bounds = AxisLimits() if limits is None else limits
    reach = np.asarray(half_range, dtype=float)
    pieces = []
    for speed in speeds:
        way = np.minimum(reach, max(2.0 * speed, 1e-3))
        corners = way * np.array(CORNERS)
        for start, stop in zip(corners[:-1], corners[1:], strict=True):
            pieces.append(_straight(start, stop, speed, period))
    if micro_time > 2.0 * FADE and micro_range > 0.0:
        amplitude = micro_range * np.array(MICRO_SHARES)
        phase = np.zeros((2, len(amplitude)))
        pieces.append(
            _sines(micro_time, period, MICRO_FREQUENCIES, np.stack([amplitude] * 2), phase)
        )
    if multisine_time > 2.0 * FADE:
        pieces.append(_multisine(reach, multisine_time, period, bounds, seed))
    position, velocity, acceleration = (
        np.concatenate([piece[i] for piece in pieces]) for i in range(3)
    )
    jerk = np.diff(acceleration, axis=0, append=0.0) / period
    excess, name, _ = bounds.excess(velocity, acceleration, jerk)
    if excess > 1.0:
        raise StageError(f'the excitation exceeds the {name}: lower its speeds')
    return free_motion(period, position + np.asarray(centre), velocity, acceleration)


def _straight(
    start: Array, stop: Array, speed: float, period: float
) -> tuple[Array, Array, Array]:
    length = float(np.linalg.norm(stop - start))
    direction = (stop - start) / length
    profile = SCurve.plan(length, speed, *RAMP)
    time = period * np.arange(int(np.ceil((profile.duration + PAUSE) / period)))
    arc, rate, change = profile.at(time)
    return (
        start + arc[:, None] * direction,
        rate[:, None] * direction,
        change[:, None] * direction,
    )


def _multisine(
    reach: Array, duration: float, period: float, limits: AxisLimits, seed: int
) -> tuple[Array, Array, Array]:
    generator = np.random.default_rng(seed)
    omega = 2.0 * np.pi * np.array(FREQUENCIES)
    share = 0.5 / len(omega)
    amplitude = np.stack(
        [
            share
            * np.minimum(
                np.minimum(reach[axis], limits.speed[axis] / omega),
                np.minimum(limits.acceleration[axis] / omega**2, limits.jerk[axis] / omega**3),
            )
            for axis in range(2)
        ]
    )
    phase = generator.uniform(0.0, 2.0 * np.pi, (2, len(omega)))
    return _sines(duration, period, FREQUENCIES, amplitude, phase)


def _sines(
    duration: float,
    period: float,
    frequencies: Sequence[float],
    amplitude: Array,
    phase: Array,
) -> tuple[Array, Array, Array]:
    """Sum of sines on each axis that fades in and out; amplitude [m] and phase are (2, k)."""
    time = period * np.arange(int(np.ceil(duration / period)) + 1)
    edge = np.clip(np.minimum(time, time[-1] - time) / FADE, 0.0, 1.0)
    # Quintic smooth step and its derivatives: no step in velocity or acceleration.
    sign = np.where(time < 0.5 * time[-1], 1.0, -1.0) / FADE * (edge < 1.0)
    fade = edge**3 * (10.0 - 15.0 * edge + 6.0 * edge**2)
    fade_1 = sign * 30.0 * edge**2 * (1.0 - edge) ** 2
    fade_2 = 60.0 * edge * (1.0 - edge) * (1.0 - 2.0 * edge) / FADE**2 * (edge < 1.0)
    omega = 2.0 * np.pi * np.array(frequencies)
    columns = []
    for axis in range(2):
        angle = omega * time[:, None] + phase[axis]
        wave = np.sin(angle) @ amplitude[axis]
        wave_1 = np.cos(angle) @ (amplitude[axis] * omega)
        wave_2 = -np.sin(angle) @ (amplitude[axis] * omega**2)
        columns.append(
            (
                fade * wave,
                fade * wave_1 + fade_1 * wave,
                fade * wave_2 + 2.0 * fade_1 * wave_1 + fade_2 * wave,
            )
        )
    position, velocity, acceleration = (
        np.column_stack([columns[axis][i] for axis in range(2)]) for i in range(3)
    )
    return position, velocity, acceleration
