"""The table that a session prints: errors before and after in µm."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stage_core.arrays import Array
from stage_core.metrics import Metrics
from stage_core.quantities import MICROMETRE


@dataclass(frozen=True)
class Row:
    """One quantity of the table, in metres."""

    name: str
    before: Metrics
    after: Metrics


def distance_metrics(errors: Array) -> Metrics:
    """Metrics of the distance between wanted and measured points, errors (n, 2) [m]."""
    return Metrics.of(np.hypot(errors[:, 0], errors[:, 1]))


def heldout_rows(before: Array, after: Array) -> list[Row]:
    """Rows of the held-out points: per axis and distance, errors (n, 2) [m]."""
    return [
        Row('held-out x', Metrics.of(before[:, 0]), Metrics.of(after[:, 0])),
        Row('held-out y', Metrics.of(before[:, 1]), Metrics.of(after[:, 1])),
        Row('held-out distance', distance_metrics(before), distance_metrics(after)),
    ]


def render(rows: list[Row]) -> str:
    """The table as text, every figure in µm at k = 1."""
    head = f'{"error [µm]":<26}' + ''.join(
        f'{f"{name} {when}":>13}'
        for when in ('before', 'after')
        for name in ('RMS', 'MAE', 'max', 'σ')
    )
    lines = [head, '-' * len(head)]
    for row in rows:
        figures = [
            value / MICROMETRE
            for f in (row.before, row.after)
            for value in (f.rms, f.mae, f.max, f.sigma)
        ]
        lines.append(f'{row.name:<26}' + ''.join(f'{v:>13.2f}' for v in figures))
    return '\n'.join(lines)


def as_dict(rows: list[Row]) -> dict[str, dict[str, dict[str, float]]]:
    """The table for a file, in metres."""
    return {row.name: {'before': vars(row.before), 'after': vars(row.after)} for row in rows}
