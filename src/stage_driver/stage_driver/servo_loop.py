"""The control law of the nominal servo twin, one control tick at a time.

Equations: docs/reference/interfaces.md, "Servo controller".

All functions work in place on arrays with one row or element per axis and allocate nothing.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numba import njit

from stage_core.arrays import Array
from stage_core.twin_file import TwinFile

POSITION_GAIN, FEEDFORWARD, VELOCITY_GAIN, INTEGRAL_GAIN, FILTER_POLE, FORCE_LIMIT = range(6)
"""Columns of the gains array; the filter's pole is a = exp(-Ts * velocity_filter)."""
PREVIOUS, VELOCITY, INTEGRAL = range(3)
"""Columns of the memory array: q_(k-1) [m], vf_(k-1) [m/s], I_k [N]."""


def loop_gains(twin: TwinFile, axes: Sequence[str]) -> Array:
    """Gains (axes, 6) of a twin file; rows in the order of `axes`."""
    rows = []
    for axis in axes:
        servo = twin.servo(axis)
        pole = math.exp(-twin.control_period * servo.velocity_filter)
        rows.append(
            [
                servo.position_gain,
                servo.velocity_feedforward,
                servo.velocity_gain,
                servo.integral_gain,
                pole,
                servo.force_limit,
            ]
        )
    return np.array(rows, dtype=np.float64)


def start_memory(encoder: Array) -> Array:
    """Memory (axes, 3) at rest: q_(-1) = q_0, vf_(-1) = 0, I_0 = 0."""
    memory = np.zeros((len(encoder), 3))
    memory[:, PREVIOUS] = encoder
    return memory


@njit(cache=True)
def estimate_velocity(encoder: Array, memory: Array, gains: Array, period: float) -> None:
    """vf_k = a vf_(k-1) + (1 - a) (q_k - q_(k-1)) / Ts, into the memory."""
    for i in range(len(encoder)):
        pole = gains[i, FILTER_POLE]
        difference = (encoder[i] - memory[i, PREVIOUS]) / period
        memory[i, VELOCITY] = pole * memory[i, VELOCITY] + (1.0 - pole) * difference
        memory[i, PREVIOUS] = encoder[i]


@njit(cache=True)
def position_loop(
    reference: Array, speed: Array, encoder: Array, gains: Array, command: Array
) -> None:
    """vc_k = velocity_feedforward * dr_k + position_gain * (r_k - q_k), into `command`."""
    for i in range(len(encoder)):
        forward = gains[i, FEEDFORWARD] * speed[i]
        command[i] = forward + gains[i, POSITION_GAIN] * (reference[i] - encoder[i])


def matching_reference(command: Array, encoder: Array, gains: Array) -> Array:
    """Reference r (axes,) [m] at which the position loop gives `command` as dr and as vc."""
    rest = (1.0 - gains[:, FEEDFORWARD]) * command
    return np.asarray(encoder + rest / gains[:, POSITION_GAIN])


def following_lag(gains: Array) -> Array:
    """Time [s] (axes,) by which a loop without full feed-forward is behind its reference."""
    return np.asarray((1.0 - gains[:, FEEDFORWARD]) / gains[:, POSITION_GAIN])


@njit(cache=True)
def velocity_loop(
    command: Array, memory: Array, gains: Array, period: float, force: Array
) -> None:
    """F_k = clip(velocity_gain * ev_k + I_k), then I_(k+1), held while that would wind up."""
    for i in range(len(command)):
        error = command[i] - memory[i, VELOCITY]
        wanted = gains[i, VELOCITY_GAIN] * error + memory[i, INTEGRAL]
        limit = gains[i, FORCE_LIMIT]
        force[i] = min(max(wanted, -limit), limit)
        clipped = wanted > limit or wanted < -limit
        if not (clipped and error * wanted > 0.0):
            memory[i, INTEGRAL] += gains[i, INTEGRAL_GAIN] * error * period


@njit(cache=True)
def lugre_velocity(
    speed: Array, bristles: Array, friction: Array, gains: Array, period: float, out: Array
) -> None:
    """Add the velocity that makes the loop's P part push with the LuGre friction force.

    Eqs. 6-7 of paper 3 with the commanded velocity `speed` (the encoder's velocity step is as
    large as the Stribeck velocity), integrated exactly over one tick at constant speed.
    `friction` (axes, 4): Coulomb force [N], static force [N], Stribeck velocity [m/s], presliding
    [m] (the deflection at which the bristles carry the Coulomb force). `bristles` (axes,) [m].
    """
    for i in range(len(speed)):
        coulomb, static, stribeck, presliding = friction[i]
        if coulomb <= 0.0:
            continue
        stiffness = coulomb / presliding
        ratio = speed[i] / stribeck
        level = (coulomb + (static - coulomb) * math.exp(-ratio * ratio)) / stiffness
        steady = level if speed[i] >= 0.0 else -level
        decay = math.exp(-abs(speed[i]) * period / level)
        bristles[i] = steady + (bristles[i] - steady) * decay
        out[i] += stiffness * bristles[i] / gains[i, VELOCITY_GAIN]


@njit(cache=True)
def expect(predicted: Array, before: Array, lag: Array, period: float, expected: Array) -> None:
    """Error of a first-order loop, de/dt = dr/dt - e / lag, one tick on.

    `predicted` (axes,) [m] is the reference of now, `before` that of the last tick, which it
    replaces; `lag` (axes,) [s]; `expected` (axes,) [m] is updated.
    """
    for i in range(len(expected)):
        expected[i] += predicted[i] - before[i] - period / lag[i] * expected[i]
        before[i] = predicted[i]


@njit(cache=True)
def stray(predicted: Array, encoder: Array, expected: Array, limit: float) -> int:
    """First axis whose error is larger by `limit` [m] than expected; -1 where none is."""
    for i in range(len(encoder)):
        if abs(predicted[i] - encoder[i]) - abs(expected[i]) > limit:
            return i
    return -1
