"""Simulation of a whole session with a servo twin."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stage_core.errors import StageError
from stage_core.twin_file import TwinFile
from stage_twin import hooks
from stage_twin.geometry import table_path
from stage_twin.packing import KernelArrays, Work, columns, pack
from stage_twin.session_kernel import run_session
from stage_twin.tracker import measure


@dataclass(frozen=True)
class SimulationResult:
    """What a session of n ticks and m tracker points holds; SI units, axes as in the file.

    Attributes
    ----------
    times : (n,)
        Stamps: t_k = k * control_period.
    encoder, velocity, velocity_command, force : (n, n_axes)
        q_k, vf_k, vc_k and F_k of docs/reference/interfaces.md, "Servo controller".
    table : (n, n_axes)
        Table position.
    temperatures : (n, n_axes)
        Screw temperatures [degC].
    tracker_stamps : (m,), tracker_points : (m, 3)
        Tracker's stamps, in seconds of its clock from the session's start, and its points.
    """

    times: np.ndarray
    encoder: np.ndarray
    velocity: np.ndarray
    velocity_command: np.ndarray
    force: np.ndarray
    table: np.ndarray
    temperatures: np.ndarray
    tracker_stamps: np.ndarray
    tracker_points: np.ndarray


def _loop(
    twin: TwinFile,
    reference: np.ndarray,
    reference_velocity: np.ndarray,
    compensation: np.ndarray | None,
) -> tuple[KernelArrays, np.ndarray, np.ndarray]:
    """Arrays of the twin, and channels (6, n, n_axes) of `run_session` with the recorded forces.

    These are (n, n_axes) [N]. Raises as `simulate` does.
    """
    if twin.kind != 'servo':
        raise StageError(f'a session can be simulated with a servo twin, this one is {twin.kind}')
    arrays = pack(twin)
    reference = columns('reference', reference, None, arrays)
    velocity = columns('reference_velocity', reference_velocity, len(reference), arrays)
    more = np.zeros_like(reference)
    if compensation is not None:
        more = columns('compensation', compensation, len(reference), arrays)
    channels, force = np.zeros((6, *reference.shape)), np.zeros(reference.shape[::-1])
    start, work = reference[0].copy(), Work.of(len(arrays.axes))
    run_session(arrays, work, start, reference, velocity, more, force, channels)
    recorded = [hooks.recorded(row, own) for row, own in zip(arrays.axes, force, strict=True)]
    if not np.isfinite(recorded).all():
        raise StageError(f'the twin flies away: weaken its effects {", ".join(twin.effects)}')
    return arrays, channels, np.column_stack(recorded)


def simulate_loop(
    twin: TwinFile,
    reference: np.ndarray,
    reference_velocity: np.ndarray,
    compensation: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Encoder [m] and force [N], both (n, n_axes), of what :func:`simulate` simulates."""
    _, channels, force = _loop(twin, reference, reference_velocity, compensation)
    return channels[0], force


def simulate(
    twin: TwinFile,
    reference: np.ndarray,
    reference_velocity: np.ndarray,
    *,
    compensation: np.ndarray | None = None,
    temperatures: np.ndarray | None = None,
    seed: int = 0,
    tracker_times: np.ndarray | None = None,
    noise: bool = True,
) -> SimulationResult:
    """Simulate a session of a servo twin from rest at the first reference position.

    Parameters
    ----------
    reference, reference_velocity : (n, n_axes)
        r_k [m] and its derivative [m/s].
    compensation : (n, n_axes), optional
        Added to the velocity command vc_k [m/s].
    temperatures : (n, n_axes), optional
        Screw temperatures [degC]; without them the thermal effect's own model gives them.
    seed : int
        Of the tracker's noise.
    tracker_times : (m,), optional
        Stamps [s] of the tracker's clock at which points are wanted; without them the
        tracker of the file measures at its rate.
    noise : bool
        Whether the tracker's noise is added.

    Raises
    ------
    StageError
        If an array's shape does not fit, the twin is not a servo twin or wrong, or its effects
        throw the stage away.
    """
    arrays, channels, force = _loop(twin, reference, reference_velocity, compensation)
    rise, count = channels[5], len(force)
    if temperatures is not None:
        rise = columns('temperatures', temperatures, count, arrays) - twin.temperature_reference
    table = np.zeros_like(rise)
    table_path(arrays, channels[3], channels[4], rise, table)
    stamps, points = measure(twin, arrays, table, tracker_times, seed, noise)
    return SimulationResult(
        times=hooks.tick_stamp(arrays.common, np.arange(count) * arrays.period),
        encoder=channels[0],
        velocity=channels[1],
        velocity_command=channels[2],
        force=force,
        table=table,
        temperatures=rise + twin.temperature_reference,
        tracker_stamps=stamps,
        tracker_points=points,
    )
