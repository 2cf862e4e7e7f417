"""A machine that shares no code with the digital twin: its own plant, integrator and friction.

The controller is that of interfaces.md, "Servo controller", which every implementation
shares. The plant does not follow the twin: semi-implicit Euler at a twentieth of a tick,
Maxwell-slip friction (eight elasto-plastic elements, Al-Bender, Lampaert and Swevers, IEEE
Trans. Autom. Control 50, 2005), and a payload on a spring of its own where the structure is
flexible.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from stage_core.arrays import Array

SUBSTEPS = 20
ELEMENTS = 8

#: Plant constants of one axis, in the order of the kernel's argument.
PLANT = (
    'mass',
    'viscous_positive',
    'viscous_negative',
    'coulomb_positive',
    'coulomb_negative',
    'breakaway_extra',
    'stribeck_velocity',
    'presliding',
    'offset',
    'ripple',
    'ripple_phase',
    'ripple_period',
    'cable_stiffness',
    'cable_centre',
    'drive_gain',
    'saturation',
    'delay',
    'payload_mass',
    'payload_frequency',
    'payload_damping',
    'disturbance',
    'disturbance_frequency',
    'position_bump',
)
#: Controller constants of one axis, as docs/reference/interfaces.md, "Twin file", names them.
CONTROLLER = (
    'encoder_resolution',
    'position_gain',
    'velocity_feedforward',
    'velocity_gain',
    'integral_gain',
    'velocity_filter',
    'force_limit',
)


@njit(cache=True, nogil=True)
def _acting(force: float, x: float, swing: float, plant: tuple[float, ...]) -> float:
    """Force on the motor beside friction and payload; `swing` is the disturbance's angle."""
    _, _, _, _, _, _, _, _, offset, ripple, phase, ripple_period, cable, centre, gain = plant[:15]
    saturation, disturb, bump = plant[15], plant[20], plant[22]
    applied = gain * min(max(force, -saturation), saturation)
    applied -= offset + cable * (x - centre)
    applied -= ripple * math.sin(2.0 * math.pi * x / ripple_period + phase)
    applied -= bump * math.exp(-(((x - centre) / 0.008) ** 2))
    return applied + disturb * math.sin(swing)


@njit(cache=True, nogil=True)
def _friction(
    x: float, v: float, anchors: Array, reach: Array, plant: tuple[float, ...]
) -> float:  # fmt: skip
    """Friction at a position and speed; the elements' `anchors` (ELEMENTS,) follow."""
    _, bp, bn, cp, cn, extra, vs = plant[:7]
    level = cp if v >= 0.0 else cn
    if extra > 0.0:
        level += extra * math.exp(-((v / vs) ** 2))
    friction = 0.0
    if level > 0.0:
        for e in range(ELEMENTS):
            stretch = min(max(x - anchors[e], -reach[e]), reach[e])
            if abs(stretch) == reach[e]:
                anchors[e] = x - stretch
            friction += level * stretch / reach[e] / ELEMENTS
    return friction + (bp if v >= 0.0 else bn) * v


@njit(cache=True, nogil=True)
def _move(motion: Array, force: float, h: float, plant: tuple[float, ...]) -> None:
    """Advance motor and payload, `motion` their positions and speeds (x, v, xl, vl)."""
    x, v, xl, vl = motion
    mass, pm, w, pz = plant[0], plant[17], 2.0 * math.pi * plant[18], plant[19]
    if pm > 0.0:
        spring = pm * (w * w * (x - xl) + 2.0 * pz * w * (v - vl))
        motion[3] = vl + h * spring / pm
        motion[2] = xl + h * motion[3]
        motion[1] = v + h * (force - spring) / (mass - pm)
    else:
        motion[1] = v + h * force / mass
    motion[0] = x + h * motion[1]


@njit(cache=True, nogil=True)
def run_axis(
    period: float,
    reference: Array,
    reference_velocity: Array,
    plant: tuple[float, ...],
    control: tuple[float, ...],
    resolution: float,
) -> tuple[Array, Array, Array, Array, Array]:
    """Closed loop of one axis over n ticks; `resolution` is the encoder that really is there.

    Returns the motor position at the ticks, encoder, filtered velocity, velocity command and
    force, each of shape (n,).
    """
    _, kp, ff, kv, ki, wf, limit = control
    n = len(reference)
    h = period / SUBSTEPS
    late = int(round(plant[16] / h))
    history = np.zeros(late + 1)
    out = np.empty((5, n))
    motion = np.array([reference[0], 0.0, reference[0], 0.0])
    anchors = np.full(ELEMENTS, reference[0])
    # Elements yield one after the other up to twice the mean presliding distance.
    reach = plant[7] * 2.0 * (np.arange(ELEMENTS) + 0.5) / ELEMENTS
    decay = math.exp(-period * wf)
    integral = vf = 0.0
    q_before = round(reference[0] / resolution) * resolution
    step = 0
    for k in range(n):
        q = round(motion[0] / resolution) * resolution
        vf = decay * vf + (1.0 - decay) * (q - q_before) / period
        q_before = q
        vc = ff * reference_velocity[k] + kp * (reference[k] - q)
        ev = vc - vf
        wanted = kv * ev + integral
        force = min(max(wanted, -limit), limit)
        if not ((wanted > limit and ev > 0.0) or (wanted < -limit and ev < 0.0)):
            integral += ki * ev * period
        out[0, k], out[1, k], out[2, k], out[3, k], out[4, k] = motion[0], q, vf, vc, force
        for _ in range(SUBSTEPS):
            history[step % (late + 1)] = force
            step += 1
            # The oldest of the ring is the one that the next step overwrites.
            x, late_force = motion[0], history[step % (late + 1)]
            applied = _acting(late_force, x, 2.0 * math.pi * plant[21] * step * h, plant)
            _move(motion, applied - _friction(x, motion[1], anchors, reach, plant), h, plant)
    return out[0], out[1], out[2], out[3], out[4]


@njit(cache=True, nogil=True)
def smooth_play(position: Array, width: float) -> Array:
    """Backlash with a soft edge: the mean of five plays of 0.8 to 1.2 times the full width."""
    out = np.zeros(len(position))
    for e in range(5):
        half = 0.5 * width * (0.8 + 0.1 * e)
        slack = 0.0
        before = position[0]
        for k in range(len(position)):
            slack = min(max(slack + position[k] - before, -half), half)
            before = position[k]
            out[k] -= slack / 5.0
    return out
