"""Play between the drive's inertia and the carriage that carries the encoder."""

from __future__ import annotations

import math

import numpy as np

from stage_core.arrays import Array
from stage_twin.effects.definition import Effect, Parameter
from stage_twin.effects.play_search import DAMPING, FREQUENCY, SOFTEST, STIFFEST, Crossing, push
from stage_twin.effects.rows import ForceRows
from stage_twin.effects.term import Term

#: Radians of the contact's oscillation that a substep may cover.
REACH = 0.2
#: Time constant [s] of an edge, from which on it delays a force as a current loop does: that of a
#: wave which the encoder misreads was 13 ms, those of right plays 4.3 ms at most.
SLOWEST = 8e-3
#: Damping ratio of an edge, up to which it is at its bound: a load on a spring was fitted with
#: 0.020, right plays of foreign simulators with 0.35 and more.
LIVELIEST = 0.025
#: What a fit gets wrong of the width, as the drive's share of the mass hardly shows: on eight
#: development sessions it found 0.58 to 1.3 of the true width.
DOUBT = 0.4

EFFECT = Effect(
    name='drive_play',
    link='servo',
    parameters=(
        Parameter('width', 'm', 0.0, 1e-3, 20e-6, 'full width of the play', doubt=DOUBT),
        Parameter(
            'mass_ratio',
            '',
            0.02,
            0.8,
            0.25,
            "share of the moving mass on the drive's side",
            neutral=None,
            doubt=DOUBT,
        ),
        Parameter(
            'contact_frequency',
            'Hz',
            SOFTEST,
            STIFFEST,
            FREQUENCY,
            "natural frequency of the drive's side on the compliance of the edges",
            neutral=None,
            doubt=DOUBT,
        ),
        Parameter(
            'contact_damping',
            '',
            0.02,
            2.0,
            DAMPING,
            'damping ratio of that mode: from edges that throw back to such that hold',
            neutral=None,
            doubt=DOUBT,
        ),
    ),
    model='Two masses with a dead zone between them, elastic and damped at both edges; the force '
    'acts on the drive\'s side, the encoder reads the other. Nordin and Gutman, "Controlling '
    'mechanical systems with backlash: a survey", Automatica 38 (2002), dead-zone model.',
    sentence='the drive crosses a play of {width} before it moves the carriage, with {mass_ratio} '
    'of the moving mass',
    excited_by='short strokes with many reversals',
    swings=True,
    states=('position', 'velocity'),
    order=4,
)


def prepare(axis: dict[str, float], mass_ratio: float) -> None:
    """The mass of the carriage alone [kg]."""
    axis['mass'] *= 1.0 - mass_ratio


def start(state: Array, position: float) -> None:
    """The drive in the middle of the play."""
    state[0] = position


def drive(
    state: Array,
    force: float,
    position: float,
    velocity: float,
    step: float,
    mass: float,
    width: float,
    mass_ratio: float,
    contact_frequency: float,
    contact_damping: float,
) -> float:
    """Mean force of the contact on the carriage over the step [N].

    Both sides move in substeps; the carriage's own motion is the plant's.
    """
    own = mass * mass_ratio / (1.0 - mass_ratio)
    natural = 2.0 * math.pi * contact_frequency
    stiffness, damping = own * natural * natural, 2.0 * contact_damping * own * natural
    # The lighter the carriage, the faster both swing against one another.
    count = int(step * natural * math.sqrt(1.0 + own / mass) / REACH) + 1
    short, total = step / count, 0.0
    for _ in range(count):
        contact = push(state[0] - position, state[1] - velocity, width, stiffness, damping)
        state[1] += short * (force - contact) / own
        velocity += short * contact / mass
        state[0] += short * state[1]
        position += short * velocity
        total += contact
    return total / count


def command(force: Array, velocity: Array, step: float, mass: float, mass_ratio: float) -> Array:
    """Force to command for a force on the carriage while both sides touch, (n,) [N]."""
    return np.asarray(force + mass * mass_ratio / (1.0 - mass_ratio) * np.gradient(velocity, step))


def term(rows: ForceRows) -> Term:
    """What the drive's mass needs to cross the play; see :mod:`stage_twin.effects.play_search`."""
    crossing = Crossing(rows)
    return Term(
        crossing.columns,
        lambda theta, c: {
            'width': theta[0] / theta[1],
            'mass_ratio': theta[1],
            'contact_damping': theta[2],
            'contact_frequency': theta[3],
        },
        propose=crossing.propose,
        lower=(0.0, 0.02, 0.02, SOFTEST),
        upper=(2e-4, 0.8, 2.0, STIFFEST),
        admissible=lambda theta, c: (
            theta[0] > 0.0
            and 0.03 < theta[1] < 0.7
            and LIVELIEST < theta[2] < SLOWEST * math.pi * theta[3]
        ),
        fixed=True,
        steps=(2e-8, 5e-3, 0.02, 5.0),
    )
