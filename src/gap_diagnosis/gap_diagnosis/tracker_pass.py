"""The pass over the tracker's points: where they are, and what their residual shows."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

from gap_diagnosis.input import coarse
from gap_diagnosis.input.data import Record
from gap_diagnosis.memory import Memory
from gap_diagnosis.parameters import Parameters, plain_values
from gap_diagnosis.passes import Prepared, Progress
from gap_diagnosis.residuals.kinematics import Kinematics
from gap_diagnosis.residuals.measured_noise import rest_scatter
from gap_diagnosis.residuals.nominal import sensor_frame
from gap_diagnosis.residuals.tracker_jitter import jitter_weights
from gap_diagnosis.selection.parts import (
    KINEMATIC_RULES,
    LEAST_RESTS,
    LEAST_ROWS,
    REST_RULES,
    Part,
    fit_part,
)
from gap_diagnosis.selection.rivals import find_rivals
from stage_core.arrays import Array
from stage_twin.effects import seen_by_tracker


def tracker_part(
    before: Prepared,
    servo: list[Parameters],
    seed: int,
    without: Sequence[str],
    memory: Memory,
    progress: Progress,
) -> tuple[list[Record], list[Part]]:
    """The tracker's residual, if there is a tracker, and the records with its points in place.

    `servo` are the parameters of the effects of each axis.
    """
    if any(r.tracker is None for r in before.records):
        return before.records, []
    stay = frozenset(without) & set(coarse.MOVED)
    records = memory.once(('points', stay), lambda: _in_place(before, stay))
    # Only what the tracker sees makes another fit of it.
    values = plain_values({k: v for f in servo for k, v in f.items() if seen_by_tracker(k)})
    without = [n for n in without if seen_by_tracker(n)]

    def fit() -> Part:
        progress('encoder -> table -> tracker: residual of the measurement')
        kinematics = Kinematics(records, before.seen, values)
        rests = kinematics.rests
        rules, least = (REST_RULES, LEAST_RESTS) if rests else (KINEMATIC_RULES, LEAST_ROWS)
        known = rests and rest_scatter(before.twin, records) is not None

        def fitted(weights: Array | None = None) -> Part:
            problem = kinematics.problem()
            part = fit_part('tracker', problem, rules, seed, without, least, known, weights)
            return replace(part, row_axis=kinematics.row_axis(), rows=kinematics)

        part = fitted()
        weights = jitter_weights(part)
        part = part if weights is None else fitted(weights)
        find_rivals(part.selector, part.selection)
        return part

    return records, [memory.once(('tracker', tuple(sorted(without)), repr(values)), fit)]


def _in_place(before: Prepared, stay: Collection[str]) -> list[Record]:
    """Records whose tracker points are in the twin's frame, moved back by what may be there."""
    frame = sensor_frame(before.twin)
    records = [replace(coarse.moved_back(r, frame), frame=frame) for r in before.records]
    moved = coarse.find(records).without(stay)
    return [replace(coarse.moved_back(r, moved), coarse=moved) for r in records]
