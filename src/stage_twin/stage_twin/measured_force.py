"""A rig whose controller is unknown: its recorded force drives the plant (interfaces.md).

The forward simulation runs in consecutive short windows from the smoothed recorded state;
the inverse one gives the force that the model needs for the recorded motion.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from stage_core.errors import StageError
from stage_core.twin_file import ForceAxis, TwinFile
from stage_twin import hooks, layout
from stage_twin.force_kernel import follow_hidden_states, needed_force, run_windows
from stage_twin.packing import KernelArrays, Work, columns, pack

#: Length of a window of the forward simulation [s].
WINDOW = 0.1
#: Width of the smoothing of the recorded position [s].
SMOOTHING = 0.01
_ORDER = 3


class Motion(NamedTuple):
    """Smoothed recorded motion, each (n, n_axes): m, m/s, m/s^2."""

    position: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray


@dataclass(frozen=True)
class MeasuredForceResult:
    """Channels of a measured-force twin, each (n, n_axes); SI units.

    Attributes
    ----------
    encoder, velocity
        Simulated motor position and velocity, restarted at every window.
    force : recorded force [N].
    required : force that the model needs for the recorded motion [N].
    """

    encoder: np.ndarray
    velocity: np.ndarray
    force: np.ndarray
    required: np.ndarray


def smooth_motion(position: np.ndarray, period: float) -> Motion:
    """Position, velocity and acceleration of a recorded position (n, n_axes).

    Savitzky-Golay, third order, over `SMOOTHING` seconds: a local polynomial has no phase, and its
    derivatives belong to the same polynomial as the position.

    Raises
    ------
    StageError
        If the record is shorter than the smoothing.
    """
    from scipy.signal import savgol_filter

    window = _window(period)
    position = np.asarray(position, dtype=float)
    if position.shape[0] < window:
        raise StageError(
            f'{position.shape[0]} samples are too few: the smoothing alone takes {window}'
        )
    smooth, velocity, acceleration = (
        np.ascontiguousarray(
            savgol_filter(position, window, _ORDER, deriv=order, delta=period, axis=0)
        )
        for order in range(3)
    )
    return Motion(smooth, velocity, acceleration)


def _window(period: float) -> int:
    return max(_ORDER + 2, 2 * round(0.5 * SMOOTHING / period) + 1)


def required_force(twin: TwinFile, position: np.ndarray) -> np.ndarray:
    """Force command that the twin needs for a recorded motion, at the tick it must be given.

    Parameters
    ----------
    position : (n, n_axes)
        Recorded encoder [m] at the twin's control period.

    Returns
    -------
    (n, n_axes) [N]; with a delay the last entries repeat the last one known.

    Raises
    ------
    StageError
        If shapes do not fit, values are not finite, or the twin is wrong.
    """
    arrays = pack(twin)
    position = columns('position', position, None, arrays)
    motion = smooth_motion(position, arrays.period)
    states = _hidden_states(arrays, motion, np.zeros_like(position))
    return _required(arrays, motion, states)


def simulate_measured_force(
    twin: TwinFile,
    position: np.ndarray,
    effort: np.ndarray,
) -> MeasuredForceResult:
    """Simulate a rig with its recorded force as input, in consecutive windows.

    Parameters
    ----------
    position : (n, n_axes)
        Recorded encoder [m] at the twin's control period.
    effort : (n, n_axes)
        Recorded force, in the axis's `effort_unit`.

    Raises
    ------
    StageError
        If shapes do not fit, values are not finite, or the twin is wrong.
    """
    arrays = pack(twin)
    position = columns('position', position, None, arrays)
    effort = columns('effort', effort, position.shape[0], arrays)
    units = [a.effort_unit if isinstance(a, ForceAxis) else 1.0 for a in twin.axes.values()]
    force = effort * np.array(units)
    motion = smooth_motion(position, arrays.period)
    states = _hidden_states(arrays, motion, force)
    ticks = max(1, round(WINDOW / arrays.period))
    simulated = np.zeros_like(position)
    velocity = np.zeros_like(position)
    run_windows(
        arrays,
        Work.of(len(arrays.axes)),
        states,
        np.ascontiguousarray(force.T),
        ticks,
        simulated,
        velocity,
    )
    return MeasuredForceResult(
        encoder=simulated,
        velocity=velocity,
        force=force,
        required=_required(arrays, motion, states),
    )


def _hidden_states(arrays: KernelArrays, motion: Motion, force: np.ndarray) -> np.ndarray:
    states = np.zeros((*motion.position.shape, layout.STATE_WIDTH))
    follow_hidden_states(arrays, np.stack(motion), force, states)
    return states


def _required(arrays: KernelArrays, motion: Motion, states: np.ndarray) -> np.ndarray:
    out = np.zeros_like(motion.position)
    needed_force(arrays, np.zeros(layout.STATE_WIDTH), np.stack(motion), states, out)
    ticks = np.arange(out.shape[0], dtype=float)
    for axis, row in enumerate(arrays.axes):
        wanted = hooks.command(row, out[:, axis], motion.velocity[:, axis], arrays.period)
        # A held force acts, on average, half a tick after its own tick.
        delay = row[layout.DELAY] / arrays.period
        out[:, axis] = np.interp(ticks + delay + 0.5, ticks, wanted)
    return out
