"""Last refinement of servo effects in closed loop, from the warm start of the force balance.

The force balance weighs all frequencies alike in force; the user's gap is the encoder's. A few
damped Gauss-Newton steps on the replayed encoder, on fit windows only, close the difference.
They are kept only if the gap on these windows shrinks.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.closed_loop.replay import replay
from gap_diagnosis.input.data import Record, held_out_windows, inside
from stage_core.errors import StageError
from stage_core.quantities import split_effect
from stage_core.twin_file import TwinFile
from stage_twin import hooks
from stage_twin.effects import EFFECTS

Array = NDArray[np.float64]
Parameters = dict[str, dict[str, tuple[float, float]]]

ROUNDS = 3
WORTHWHILE = 0.97  # of the RMS on the fit windows


def one_axis(record: Record, axis: str) -> Record:
    """A record of one axis alone, without tracker."""
    i = record.column(axis)
    columns = {
        name: getattr(record, name)[:, [i]]
        for name in (
            'reference',
            'reference_velocity',
            'velocity_command',
            'force',
            'encoder',
        )
    }
    warm = None if record.temperature is None else record.temperature[:, [i]]
    return replace(
        record,
        axes=(axis,),
        moving=(record.moving[i],),
        temperature=warm,
        tracker=None,
        tracker_time=None,
        **columns,
    )


def polish(
    records: list[Record], twin: TwinFile, axis: str, found: Parameters, fixed: Parameters
) -> Parameters:
    """Parameters of the servo effects of an axis, refined on the encoder of the fit windows.

    `fixed` are effects of the axis that the record itself tells: they stay as they are.
    Returns them unchanged where the gap is at the encoder's step already or nothing is gained.
    """
    fitted = [r for r in records if not r.held_out_session]
    if not any(hooks.couples(split_effect(e)[0]) for e in {**fixed, **found}):
        fitted = [one_axis(r, axis) for r in fitted]
    names = [
        (effect, key)
        for effect, values in found.items()
        for key, (_, deviation) in values.items()
        if deviation > 0.0
    ]
    if not names:
        return found
    start = np.array([found[e][k][0] for e, k in names])
    scale = np.array([max(3.0 * found[e][k][1], 0.02 * abs(found[e][k][0])) for e, k in names])
    bounds = [EFFECTS[split_effect(e)[0]].parameter(k) for e, k in names]
    low = np.array([b.minimum for b in bounds])
    high = np.array([b.maximum for b in bounds])

    def gap(z: Array) -> Array:
        values = np.clip(start + scale * z, low, high)
        effects: dict[str, dict[str, float]] = {
            e: {k: v for k, (v, _) in p.items()} for e, p in {**fixed, **found}.items()
        }
        for (effect, key), value in zip(names, values, strict=True):
            effects[effect][key] = float(value)
        parts = []
        for record in fitted:
            mask = ~inside(record.time, held_out_windows(record)) & (record.time > 0.5)
            mask &= record.whole(record.time)
            parts.append(replay(record, twin, effects)[f'encoder.{axis}'][mask][::2])
        return np.concatenate(parts)

    z = np.zeros(len(names))
    step = float(getattr(twin.axes[axis], 'encoder_resolution', 1e-6))
    try:
        residual = gap(z)
        first = float(np.sqrt(np.mean(residual**2)))
        if first < step:
            return found
        for _ in range(ROUNDS):
            jacobian = np.column_stack(
                [(gap(z + 0.3 * unit) - residual) / 0.3 for unit in np.eye(len(z))]
            )
            gram = jacobian.T @ jacobian
            gram += np.diag(0.03 * np.diag(gram) + 1e-30)
            move = np.clip(-np.linalg.solve(gram, jacobian.T @ residual), -2.0, 2.0)
            trial = gap(z + move)
            if float(trial @ trial) >= float(residual @ residual):
                break
            z, residual = z + move, trial
    except StageError:
        # A step left the range in which the twin is a machine: the warm start stands.
        return found
    if float(np.sqrt(np.mean(residual**2))) > WORTHWHILE * first:
        return found
    refined: Parameters = {e: dict(p) for e, p in found.items()}
    for (effect, key), value in zip(names, np.clip(start + scale * z, low, high), strict=True):
        refined[effect][key] = (float(value), found[effect][key][1])
    return refined
