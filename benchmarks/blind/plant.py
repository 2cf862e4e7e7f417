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
from numpy.typing import NDArray

Array = NDArray[np.float64]

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
    (
        mass, bp, bn, cp, cn, extra, vs, presliding, offset, ripple, phase, ripple_period, cable,
        centre, gain, saturation, delay, pm, pf, pz, disturb, disturb_f, bump,
    ) = plant  # fmt: skip
    _, kp, ff, kv, ki, wf, limit = control
    n = len(reference)
    h = period / SUBSTEPS
    late = int(round(delay / h))
    history = np.zeros(late + 1)
    motor = np.empty(n)
    encoder = np.empty(n)
    filtered = np.empty(n)
    command = np.empty(n)
    force_out = np.empty(n)
    x = reference[0]
    v = 0.0
    xl = x
    vl = 0.0
    anchors = np.full(ELEMENTS, x)
    shares = np.empty(ELEMENTS)
    reach = np.empty(ELEMENTS)
    for e in range(ELEMENTS):
        shares[e] = 1.0 / ELEMENTS
        # Elements yield one after the other up to twice the mean presliding distance.
        reach[e] = presliding * 2.0 * (e + 0.5) / ELEMENTS
    decay = math.exp(-period * wf)
    integral = 0.0
    q_before = round(x / resolution) * resolution
    vf = 0.0
    w = 2.0 * math.pi * pf
    step = 0
    for k in range(n):
        q = round(x / resolution) * resolution
        vf = decay * vf + (1.0 - decay) * (q - q_before) / period
        q_before = q
        vc = ff * reference_velocity[k] + kp * (reference[k] - q)
        ev = vc - vf
        wanted = kv * ev + integral
        force = min(max(wanted, -limit), limit)
        if not ((wanted > limit and ev > 0.0) or (wanted < -limit and ev < 0.0)):
            integral += ki * ev * period
        motor[k] = x
        encoder[k] = q
        filtered[k] = vf
        command[k] = vc
        force_out[k] = force
        for _ in range(SUBSTEPS):
            history[step % (late + 1)] = force
            applied = history[(step + 1) % (late + 1)] if late > 0 else force
            step += 1
            applied = gain * min(max(applied, -saturation), saturation)
            applied -= offset + cable * (x - centre)
            applied -= ripple * math.sin(2.0 * math.pi * x / ripple_period + phase)
            applied -= bump * math.exp(-(((x - centre) / 0.008) ** 2))
            applied += disturb * math.sin(2.0 * math.pi * disturb_f * step * h)
            level = cp if v >= 0.0 else cn
            if extra > 0.0:
                level += extra * math.exp(-((v / vs) ** 2))
            friction = 0.0
            if level > 0.0:
                for e in range(ELEMENTS):
                    stretch = x - anchors[e]
                    if stretch > reach[e]:
                        anchors[e] = x - reach[e]
                        stretch = reach[e]
                    elif stretch < -reach[e]:
                        anchors[e] = x + reach[e]
                        stretch = -reach[e]
                    friction += shares[e] * level * stretch / reach[e]
            friction += (bp if v >= 0.0 else bn) * v
            if pm > 0.0:
                spring = pm * (w * w * (x - xl) + 2.0 * pz * w * (v - vl))
                vl += h * spring / pm
                xl += h * vl
                v += h * (applied - friction - spring) / (mass - pm)
            else:
                v += h * (applied - friction) / mass
            x += h * v
    return motor, encoder, filtered, command, force_out


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
