"""Frame of the tracker against that of the stage."""

from __future__ import annotations

import numpy as np

from stage_core.arrays import Array
from stage_twin.effects.definition import Effect, Parameter
from stage_twin.effects.rows import TrackerRows
from stage_twin.effects.term import Term, Theta, constant

EFFECT = Effect(
    name='tracker_misalignment',
    link='sensor',
    parameters=(
        Parameter('angle', 'rad', -3.2, 3.2, 100e-6, 'rotation of the frame about z'),
        Parameter('offset_x', 'm', -50.0, 50.0, 0.0, 'offset along x', nuisance=True),
        Parameter('offset_y', 'm', -50.0, 50.0, 0.0, 'offset along y', nuisance=True),
    ),
    model='measured = R(+angle) * p + offset. Eq. 24 of paper 1 (rigid part).',
    sentence='the tracker frame is turned by {angle} against the stage',
    excited_by='lines along both axes',
    per_axis=False,
    seen_by_encoder=False,
)


def seen(points: Array, angle: float, offset_x: float, offset_y: float) -> Array:
    """Table positions (m, 3) in the tracker's frame [m]."""
    out = points.copy()
    cosine, sine = np.cos(angle), np.sin(angle)
    x, y = points[:, 0], points[:, 1]
    out[:, 0] = cosine * x - sine * y + offset_x
    out[:, 1] = sine * x + cosine * y + offset_y
    return out


def term(rows: TrackerRows) -> Term:
    """A small rotation and an offset, on top of the frames taken out before."""
    if len(rows.axes) == 1:
        return _offset_alone(rows)
    parts = []
    for p in rows.points():
        one, zero = np.ones(len(p)), np.zeros(len(p))
        parts.append(
            [np.column_stack([-p[:, 1], one, zero]), np.column_stack([p[:, 0], zero, one])]
        )

    def parameters(theta: Theta, c: Array) -> dict[str, float]:
        away = c[None, 1:]
        for frame in rows.frames:
            away = frame.turned(away) + frame.away(2)
        turned = sum(frame.angle for frame in rows.frames)
        return {
            'angle': turned + float(np.arcsin(np.clip(c[0], -1.0, 1.0))),
            'offset_x': float(away[0, 0]),
            'offset_y': float(away[0, 1]),
        }

    return Term(constant(rows.rows(parts)), parameters, nuisances=(1, 2))


def _offset_alone(rows: TrackerRows) -> Term:
    away = sum(float(frame.away(1)[0]) for frame in rows.frames)
    return Term(
        constant(rows.rows([[np.ones((len(p), 1))] for p in rows.points()])),
        lambda theta, c: {'angle': 0.0, f'offset_{rows.axes[0]}': away + float(c[0])},
        nuisances=(0,),
    )
