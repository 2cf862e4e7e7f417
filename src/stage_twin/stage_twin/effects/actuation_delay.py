"""The force acts later than it is commanded."""

from __future__ import annotations

from stage_core.arrays import Array
from stage_twin.effects.definition import Effect, Parameter
from stage_twin.effects.rows import ForceRows
from stage_twin.effects.term import Term, Theta

#: Of three right delays of foreign simulators two missed by 2 and 14 %.
DOUBT = 0.03

EFFECT = Effect(
    name='actuation_delay',
    link='servo',
    parameters=(
        Parameter('delay', 's', 0.0, 0.02, 1e-3, "time added to the file's `delay`", doubt=DOUBT),
    ),
    model='The force acts later by a fieldbus cycle, a computation or a filter; exact zero-order '
    'hold with the fraction of a tick. Astrom and Wittenmark, "Computer-controlled systems" '
    '(1997), sampling of systems with time delay.',
    sentence='the force acts {delay} later than the twin says',
    excited_by='a frequency sweep',
)


def prepare(axis: dict[str, float], delay: float) -> None:
    """Delay of the force [s]."""
    axis['delay'] += delay


def term(rows: ForceRows) -> Term:
    """The force less the same force later (θ)."""
    direct = rows.applied()

    def columns(theta: Theta) -> Array:
        late = rows.applied(theta[0])
        return rows.columns([f - g for f, g in zip(direct, late, strict=True)])

    return Term(
        columns,
        lambda theta, c: {'delay': theta[0]},
        grid=tuple((d,) for d in (2e-4, 5e-4, 1e-3, 1.5e-3, 2e-3, 3e-3, 4e-3, 6e-3, 9e-3)),
        lower=(0.0,),
        upper=(0.02,),
        fixed=True,
    )
