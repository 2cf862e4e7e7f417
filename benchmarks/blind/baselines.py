"""Answers without a diagnosis, on the same recordings: what a good score has to be seen beside.

Every effect is one or a few columns of an ordinary regression on the recording, of the force
that the nominal motion does not need, or of tracker − encoder. `largest amplitude` names the one
effect that explains most by itself, as an engineer with a plot would; `fit everything` fits all
columns at once and names what differs from zero by `SIGNIFICANT` standard errors.
"""

from __future__ import annotations

import numpy as np

from benchmarks.blind.cases import Case
from benchmarks.blind.machine import NOMINAL, Recording
from stage_core.arrays import Array

Columns = dict[str, Array]

SMOOTHING = 41  # ticks of the window that positions and forces are smoothed with
STEP = 10  # ticks between the rows of the force balance
SIGNIFICANT = 4.0


def answers(case: Case, recording: Recording) -> dict[str, list[str]]:
    """Verdict of each baseline for a case."""
    problems = [_servo(recording, i) for i in range(len(recording.axes))]
    if case.tracker:
        problems.append(_tracker(recording, case.temperature))
    best, largest = '', -1.0
    everything: list[str] = []
    for target, effects in problems:
        effects = {n: c for n, c in effects.items() if n.partition('.')[0] not in case.without}
        # A free gain beside mass and friction has the trivial solution 0 = 0.
        joint = {n: c for n, c in effects.items() if not n.startswith('drive_gain')}
        names = [n for n, columns in joint.items() for _ in range(columns.shape[1])]
        matrix = np.hstack(list(joint.values()))
        scale = np.linalg.norm(matrix, axis=0) + 1e-300
        inverse = np.linalg.pinv((matrix / scale).T @ (matrix / scale), rcond=1e-9)
        coefficients = inverse @ ((matrix / scale).T @ target)
        rest = target - (matrix / scale) @ coefficients
        noise = float(np.mean(rest**2)) + 1e-300
        error = np.sqrt(np.maximum(np.diag(inverse), 0.0) * noise)
        for name in effects:
            own = [k for k, other in enumerate(names) if other == name]
            if any(abs(coefficients[k]) > SIGNIFICANT * error[k] for k in own):
                everything.append(name)
            alone, *_ = np.linalg.lstsq(effects[name], target, rcond=1e-9)
            size = float(np.mean((effects[name] @ alone) ** 2)) / noise
            if size > largest:
                best, largest = name, size
    return {
        'largest amplitude': [best],
        'fit everything': sorted(set(everything)),
        'always unknown': ['unknown'],
        'always none': [],
    }


def _smooth(signal: Array) -> Array:
    window = np.hanning(SMOOTHING + 2)[1:-1]
    return np.convolve(signal, window / window.sum(), mode='same')


def _servo(recording: Recording, i: int) -> tuple[Array, Columns]:
    """Force that the nominal motion does not need [N] and what it may be, rows in motion."""
    axis = recording.axes[i]
    nominal = NOMINAL['axes'][axis]
    period = float(NOMINAL['control_period'])
    # A force is held for a tick: what acts around a stamp is the mean of two.
    held = recording.force[:, i]
    held = 0.5 * (held + np.concatenate([held[:1], held[:-1]]))
    p, force = _smooth(recording.encoder[:, i]), _smooth(held)
    v = np.gradient(p, period)
    a = np.gradient(v, period)
    target = force - nominal['mass'] * a - nominal['viscous'] * v
    sign = np.tanh(v / 5e-4)
    up = (v > 0.0).astype(float)
    angle = 2.0 * np.pi * p / nominal['lead']
    jerk = np.gradient(a, period)
    level = 0.9 * float(np.abs(force).max())
    one = np.ones_like(p)
    effects = {
        'inertia_mismatch': [nominal['mass'] * a],
        'viscous_friction': [v],
        'coulomb_friction': [sign],
        'asymmetric_friction': [sign * up, sign * (1.0 - up)],
        'stribeck_friction': [sign * np.exp(-((v / 5e-3) ** 2))],
        'force_offset': [one],
        'force_ripple': [np.sin(angle), np.cos(angle)],
        'cable_force': [p],
        'actuation_delay': [np.gradient(force, period)],
        'structural_resonance': [np.gradient(jerk, period)],
        'force_saturation': [np.sign(force) * np.maximum(np.abs(force) - level, 0.0)],
        'drive_gain': [force],
    }
    rows = np.flatnonzero(np.abs(v) > 2e-4)
    rows = rows[(rows > 100) & (rows < len(p) - 100)][::STEP]
    return target[rows], {
        f'{name}.{axis}': np.column_stack(columns)[rows] for name, columns in effects.items()
    }


def _tracker(recording: Recording, warm: bool) -> tuple[Array, Columns]:
    """Tracker − encoder [m] and what it may be, x rows above y rows."""
    axes, time = recording.axes, recording.tracker_time
    velocity = np.gradient(recording.encoder, float(NOMINAL['control_period']), axis=0)

    def at(signal: Array) -> Array:
        return np.column_stack(
            [np.interp(time, recording.time, signal[:, i]) for i in range(len(axes))]
        )

    p = at(recording.encoder)
    v = at(np.column_stack([_smooth(velocity[:, i]) for i in range(len(axes))]))
    target = (recording.tracker - p).T.ravel()
    zero = np.zeros(len(time))

    def on(i: int, *columns: Array) -> Array:
        """Columns on the rows of one axis."""
        return np.column_stack(
            [np.concatenate([c if j == i else zero for j in range(len(axes))]) for c in columns]
        )

    effects: Columns = {'tracker_latency': -v.T.ravel()[:, None]}
    effects['tracker_clock_drift'] = -(v * time[:, None]).T.ravel()[:, None]
    for i, axis in enumerate(axes):
        angle = 2.0 * np.pi * p[:, i] / NOMINAL['axes'][axis]['lead']
        effects[f'scale_error.{axis}'] = on(i, p[:, i])
        effects[f'cyclic_pitch_error.{axis}'] = on(i, np.sin(angle), np.cos(angle))
        effects[f'backlash.{axis}'] = on(i, np.tanh(v[:, i] / 5e-4))
        if warm:
            rise = np.interp(time, recording.temperature_time, recording.temperature[:, i])
            effects[f'thermal_expansion.{axis}'] = on(i, (rise - 20.0) * p[:, i], rise - 20.0)
        if len(axes) == 2:
            effects[f'straightness.{axis}'] = on(1 - i, p[:, i] ** 2, p[:, i] ** 3)
            effects[f'angular_error.{axis}'] = on(i, p[:, i] * p[:, 1 - i])
    if len(axes) == 2:
        effects['nonorthogonality'] = on(0, p[:, 1])
        turned = np.concatenate([-p[:, 1], p[:, 0]])[:, None]
        one = np.ones(len(time))
        effects['tracker_misalignment'] = np.hstack([turned, on(0, one), on(1, one)])
    else:
        effects['tracker_misalignment'] = np.ones((len(time), 1))
    return target, effects
