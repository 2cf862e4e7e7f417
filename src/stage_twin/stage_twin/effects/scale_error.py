"""Mean pitch error of the screw or the scale."""

from __future__ import annotations

from stage_twin.effects.definition import Effect, Parameter
from stage_twin.effects.rows import TrackerRows
from stage_twin.effects.term import Term, constant

EFFECT = Effect(
    name='scale_error',
    link='kinematic',
    parameters=(Parameter('error', 'm/m', -0.1, 0.1, 50e-6, 'table = p * (1 + error)'),),
    model='Mean pitch error of the screw or the scale. ISO 230-2:2014; paper 1, section 2.',
    sentence='the travel of the table differs from that of the encoder by {error}',
    excited_by='positions over the whole travel',
)


def along(played: float, error: float) -> float:
    """Displacement of the table along the axis [m]."""
    return error * played


def term(rows: TrackerRows) -> Term:
    """The position."""
    return Term(
        constant(rows.along(rows.position())),
        lambda theta, c: {'error': float(c[0])},
    )
