"""Replay of a record with a twin: in closed loop, or with the recorded force as its input."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.data import Record
from stage_core.quantities import EFFECT_LINKS, split_effect
from stage_core.twin_file import ForceAxis, TwinFile
from stage_twin.measured_force import simulate_measured_force, smooth_motion
from stage_twin.simulate import simulate

Array = NDArray[np.float64]
Effects = Mapping[str, Mapping[str, float]]


def compensation(record: Record, twin: TwinFile) -> Array:
    """What the recorded velocity command holds beyond the nominal law, shape (n, a) [m/s].

    A friction compensation or a cross-coupled controller; it is an input of the replay.
    """
    out = np.zeros_like(record.reference)
    for i, name in enumerate(record.axes):
        axis = twin.servo(name)
        law = axis.position_gain * (record.reference[:, i] - record.encoder[:, i])
        if axis.velocity_feedforward:
            law = law + axis.velocity_feedforward * record.reference_velocity[:, i]
        out[:, i] = record.velocity_command[:, i] - law
    # Rounding of stored numbers is no compensation.
    out[np.abs(out) < 1e-9] = 0.0
    return out


def replay(record: Record, twin: TwinFile, effects: Effects) -> dict[str, Array]:
    """Gap (n,) of each encoder channel [m], and of the force where it is the input [N].

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
        and (EFFECT_LINKS[split_effect(name)[0]] == 'servo' or name.startswith('encoder'))
    }
    machine = replace(twin, axes={a: twin.axes[a] for a in record.axes}, tracker=None)
    machine = machine.with_effects(mine)
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
    return {
        f'encoder.{a}': record.encoder[:, i] - simulated.encoder[:, i]
        for i, a in enumerate(record.axes)
    }
