"""An error of the force constant."""

from __future__ import annotations

from stage_core.arrays import Array
from stage_twin.effects.definition import Effect, Parameter
from stage_twin.effects.rows import ForceRows
from stage_twin.effects.term import Term, constant

#: Of 25 right ones of three simulators the middle one missed by 0.05 %, three by 0.2 to 1.6 %: up
#: to 20 of its own deviations, which hold the noise alone.
DOUBT = 6e-4

EFFECT = Effect(
    name='drive_gain',
    link='servo',
    parameters=(
        Parameter('error', '', -0.8, 4.0, 0.05, 'acting force = (1 + error) * F', doubt=DOUBT),
    ),
    model='Error of the force constant (N per ampere, N per volt). Gautier and Briot, "Global '
    'identification of joint drive gains and dynamic parameters of robots", ASME JDSMC 136 '
    '(2014).',
    sentence='the drive gives {error} more force than it is asked for',
    excited_by='strokes at several accelerations and speeds',
    excludes=('inertia_mismatch',),
    merges=('inertia_mismatch', 'viscous_friction'),
    scales=True,
    needs_effort='a factor of the force cannot be told from the gains',
)


def drive(force: float, error: float) -> float:
    """Force that the amplifier gives [N]."""
    return force * (1.0 + error)


def command(force: Array, error: float) -> Array:
    """Force to command for a force that acts, (n,) [N]."""
    return force / (1.0 + error)


def term(rows: ForceRows) -> Term:
    """The force itself."""
    signal = rows.columns([-f for f in rows.applied()])
    return Term(
        constant(signal),
        lambda theta, c: {'error': float(c[0])},
        acting=lambda theta, c: 1.0 + float(c[0]),
    )
