"""A moving mass other than the nominal one."""

from __future__ import annotations

from stage_twin.effects.definition import Effect, Parameter
from stage_twin.effects.rows import ForceRows
from stage_twin.effects.term import Term, constant

#: Of the nominal mass: a rotor behind a screw of 2 mm moves as ten times its carriage.
MOST = 30.0

EFFECT = Effect(
    name='inertia_mismatch',
    link='servo',
    parameters=(Parameter('ratio', '', -0.8, MOST, 0.1, 'moving mass = mass * (1 + ratio)'),),
    model='A payload or a rotor that the nominal mass leaves out. Janot, Gautier, Brunot, EMPS '
    '(2019), inverse dynamic model.',
    sentence='the moving mass differs from the nominal one by {ratio} of it',
    excited_by='strokes at several accelerations',
    excludes=('drive_gain',),
    scales=True,
    needs_effort='only force over mass shows in a motion: the mass cannot be told from the gains',
)


def prepare(axis: dict[str, float], ratio: float) -> None:
    """The moving mass [kg]."""
    axis['mass'] *= 1.0 + ratio


def term(rows: ForceRows) -> Term:
    """The mass times the acceleration."""
    signal = rows.columns([rows.mass * a for a in rows.acceleration()])
    return Term(
        constant(signal),
        lambda theta, c: {'ratio': float(c[0])},
    )
