"""Play between the drive's inertia and the carriage that carries the encoder.

The diagnosis has no term for it and says `unknown`: an estimate from the recorded force and
encoder finds such a play, and half of its width.
"""

from __future__ import annotations

import math

import numpy as np

from stage_twin.effects.definition import Effect, Parameter
from stage_twin.effects.term import Array

#: Damping ratio of the contact, and radians of its oscillation that a substep may cover.
DAMPING, REACH = 0.2, 0.2

EFFECT = Effect(
    name='drive_play',
    link='servo',
    parameters=(
        Parameter('width', 'm', 0.0, 1e-3, 20e-6, 'full width of the play'),
        Parameter(
            'mass_ratio',
            '',
            0.02,
            0.8,
            0.25,
            "share of the moving mass on the drive's side",
            neutral=None,
        ),
        Parameter(
            'contact_frequency',
            'Hz',
            100.0,
            2000.0,
            300.0,
            "natural frequency of the drive's side on the compliance of the edges",
            fitted=False,
            neutral=None,
        ),
    ),
    model='Two masses with a dead zone between them, elastic and damped at both edges; the force '
    'acts on the drive\'s side, the encoder reads the other. Nordin and Gutman, "Controlling '
    'mechanical systems with backlash: a survey", Automatica 38 (2002), dead-zone model.',
    sentence='the drive crosses a play of {width} before it moves the carriage, with {mass_ratio} '
    'of the moving mass',
    excited_by='short strokes with many reversals',
    separated_from={
        'coulomb_friction': 'short strokes at several accelerations: the time without force falls '
        'with the acceleration, friction does not',
        'structural_resonance': 'the same sweep at two amplitudes: a play softens at small ones',
    },
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
) -> float:
    """Mean force of the contact on the carriage over the step [N].

    Both sides move in substeps; the carriage's own motion is the plant's.
    """
    own = mass * mass_ratio / (1.0 - mass_ratio)
    natural = 2.0 * math.pi * contact_frequency
    stiffness, damping = own * natural * natural, 2.0 * DAMPING * own * natural
    # The lighter the carriage, the faster both swing against one another.
    count = int(step * natural * math.sqrt(1.0 + own / mass) / REACH) + 1
    short, total = step / count, 0.0
    for _ in range(count):
        apart = state[0] - position
        contact = 0.0
        if abs(apart) > 0.5 * width:
            beyond = apart - math.copysign(0.5 * width, apart)
            contact = stiffness * beyond + damping * (state[1] - velocity)
            # An edge pushes and never pulls.
            contact = max(contact, 0.0) if apart > 0.0 else min(contact, 0.0)
        state[1] += short * (force - contact) / own
        velocity += short * contact / mass
        state[0] += short * state[1]
        position += short * velocity
        total += contact
    return total / count


def command(force: Array, velocity: Array, step: float, mass: float, mass_ratio: float) -> Array:
    """Force to command for a force on the carriage while both sides touch, (n,) [N]."""
    return np.asarray(force + mass * mass_ratio / (1.0 - mass_ratio) * np.gradient(velocity, step))
