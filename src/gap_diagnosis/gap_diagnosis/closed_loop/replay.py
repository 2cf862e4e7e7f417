"""Replay of a record with a twin: in closed loop, or with the recorded force as its input."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numba import njit
from numpy.typing import NDArray

from gap_diagnosis.input.data import Record
from gap_diagnosis.residuals.nominal import merged
from stage_core.quantities import split_effect
from stage_core.twin_file import ForceAxis, TwinFile
from stage_twin.effects import link_of
from stage_twin.measured_force import simulate_measured_force, smooth_motion
from stage_twin.simulate import simulate

Array = NDArray[np.float64]
Effects = Mapping[str, Mapping[str, float]]


def compensation(record: Record, twin: TwinFile) -> Array:
    """What the recorded controller did beyond the nominal law, shape (n, a) [m/s].

    A friction compensation, a cross-coupled controller, a force added behind the loop (an
    excitation), another filter of the velocity: known inputs of the replay, no gap of the plant.
    """
    out = np.zeros_like(record.reference)
    for i, name in enumerate(record.axes):
        axis = twin.servo(name)
        law = axis.position_gain * (record.reference[:, i] - record.encoder[:, i])
        if axis.velocity_feedforward:
            law = law + axis.velocity_feedforward * record.reference_velocity[:, i]
        command = _command_of_force(
            record.force[:, i],
            record.velocity_command[:, i],
            record.encoder[:, i],
            record.period,
            (axis.velocity_gain, axis.integral_gain, axis.velocity_filter, axis.force_limit),
        )
        out[:, i] = command - law
    # Rounding of stored numbers is no compensation.
    out[np.abs(out) < 1e-9] = 0.0
    return out


@njit(cache=True)
def _command_of_force(
    force: Array,
    command: Array,
    encoder: Array,
    period: float,
    gains: tuple[float, float, float, float],
) -> Array:
    """Velocity command (n,) with which the velocity loop gives a force (n,) [m/s].

    The velocity loop: docs/interfaces.md, "Servo controller".

    The law solved for its input; its memory fades within velocity_gain / integral_gain. The
    recorded command stands where the force is clipped, or where there is no gain to solve for.
    """
    gain, integral_gain, corner, limit = gains
    out = command.copy()
    decay = math.exp(-period * corner)
    velocity = integral = 0.0
    for k in range(len(force)):
        rate = (encoder[k] - encoder[max(k - 1, 0)]) / period
        velocity = decay * velocity + (1.0 - decay) * rate
        clipped = abs(force[k]) > 0.999 * limit
        if not clipped and gain > 0.0:
            out[k] = (force[k] - integral) / gain + velocity
        error = out[k] - velocity
        if not (clipped and error * force[k] > 0.0):
            integral += integral_gain * error * period
    return out


def replay(record: Record, twin: TwinFile, effects: Effects) -> dict[str, Array]:
    """Gap (n,) of each encoder channel [m] and of the force of each axis [N].

    A servo twin follows the recorded reference with its own controller (closed loop). A
    measured-force twin runs in windows of 100 ms from the recorded state. A stepper twin has no
    encoder that could show a gap.
    """
    if twin.kind == 'stepper':
        return {}
    mine = {
        name: dict(values)
        for name, values in effects.items()
        if split_effect(name)[1] in record.axes
        and (link_of(name) == 'servo' or name.startswith('encoder'))
    }
    machine = replace(twin, axes={a: twin.axes[a] for a in record.axes}, tracker=None)
    own = {n: v for n, v in twin.effects.items() if split_effect(n)[1] in (None, *record.axes)}
    machine = merged(replace(machine, effects=own), mine)
    if twin.kind == 'measured_force':
        units = [axis.effort_unit for axis in machine.axes.values() if isinstance(axis, ForceAxis)]
        result = simulate_measured_force(machine, record.encoder, record.force / np.array(units))
        gap = {
            f'encoder.{a}': record.encoder[:, i] - result.encoder[:, i]
            for i, a in enumerate(record.axes)
        }
        # The needed force follows from a smoothed motion: the recorded one is smoothed alike.
        force = smooth_motion(result.force, record.period).position
        for i, a in enumerate(record.axes):
            gap[f'force.{a}'] = force[:, i] - result.required[:, i]
        return gap
    simulated = simulate(
        machine,
        record.reference,
        np.nan_to_num(record.reference_velocity, nan=0.0),
        compensation=compensation(record, twin),
        temperatures=record.temperature,
        tracker_times=np.zeros(0),
        noise=False,
    )
    gap = {
        f'encoder.{a}': record.encoder[:, i] - simulated.encoder[:, i]
        for i, a in enumerate(record.axes)
    }
    for i, a in enumerate(record.axes):
        gap[f'force.{a}'] = record.force[:, i] - simulated.force[:, i]
    return gap
