"""The machine stands on soft mounts, and the drive pushes it away."""

from __future__ import annotations

import math

import numpy as np

from stage_core.arrays import Array
from stage_twin.effects.definition import Effect, Parameter
from stage_twin.effects.rows import ForceRows, TrackerRows
from stage_twin.effects.structural_resonance import (
    BASE_FREQUENCY,
    BASE_RATIO,
    BASE_SHARE,
    HIGHEST_MOUNT,
    carried_mass,
    mode,
    starts,
    swinging,
)
from stage_twin.effects.term import Term, constant

#: Highest frequency of mounts that a search admits [Hz].
HIGHEST = 40.0
#: Where the force has shown a load on a spring, the tracker makes a base of it only if the share
#: of the motion is within this factor of 1, as on the floor: its mass ratio is well known then.
ON_THE_FLOOR = 1.15

EFFECT = Effect(
    name='base_resonance',
    link='servo',
    parameters=(
        Parameter(
            'frequency',
            'Hz',
            0.5,
            BASE_FREQUENCY,
            8.0,
            'natural frequency of the machine on its mounts with the axis held',
            neutral=None,
        ),
        Parameter('damping', '', 0.0, 0.9, 0.05, 'damping ratio of that mode', neutral=None),
        Parameter(
            'mass_ratio', '', 0.0, BASE_RATIO, 0.1, 'moving mass as a share of the machine with it'
        ),
        Parameter(
            'floor_share',
            '',
            0.0,
            BASE_SHARE,
            0.0,
            "share of the base's motion that the tracker sees; 1: it stands on the floor, "
            '0: on the machine',
            neutral=None,
        ),
    ),
    model="The base swings on springs and dampers: b'' + 2 d w b' + w^2 b = -mass_ratio * p'', "
    'and its acceleration acts on the moving mass, whose encoder stands on the base. Rivin, '
    '"Vibration isolation of precision objects", Sound and Vibration 40 (2006).',
    sentence='the machine, of which the moving mass is {mass_ratio}, swings on its mounts at '
    '{frequency}',
    excited_by='a frequency sweep from 1 to 40 Hz',
    excludes=('structural_resonance',),
    same=lambda values: ('structural_resonance',),  # of table_share = floor_share * mass_ratio
    states=('base', 'momentum', 'last_velocity'),
)


def prepare(axis: dict[str, float], mass_ratio: float) -> None:
    """What the drive accelerates before the mounts push back: the reduced mass [kg]."""
    axis['mass'] *= 1.0 - mass_ratio


def force(
    state: Array,
    velocity: float,
    step: float,
    mass: float,
    frequency: float,
    damping: float,
    mass_ratio: float,
) -> float:
    """Mean force on the moving mass over the step [N]; the free swing of the base is exact.

    The momentum of base and moving mass, per mass of both, changes by the mounts alone:
    velocity of the base = momentum - mass_ratio * velocity, that of the step's middle.
    """
    natural = 2.0 * math.pi * frequency
    ringing = natural * math.sqrt(1.0 - damping * damping)
    shrink = math.exp(-damping * natural * step)
    cosine, sine = math.cos(ringing * step), math.sin(ringing * step)
    middle = velocity + 0.5 * (velocity - state[2])
    base, rate = state[0], state[1] - mass_ratio * middle
    slope = (rate + damping * natural * base) / ringing
    state[0] = shrink * (base * cosine + slope * sine)
    end = shrink * (rate * cosine - (natural * natural * base / ringing) * sine)
    end -= shrink * damping * natural * rate / ringing * sine
    state[1] = end + mass_ratio * middle
    state[2] = velocity
    return -mass / (1.0 - mass_ratio) * (end - rate) / step


def follow(state: Array, position: float, floor_share: float) -> float:
    """Position of the table as the tracker sees it [m]: it rides on the base."""
    return position + floor_share * state[0]


def term(rows: ForceRows) -> Term:
    """The reaction of the base; θ is its frequency and damping."""
    return Term(
        swinging(rows),
        mode,
        grid=starts(3.0, 36.0),
        lower=(2.0, 0.0),
        upper=(HIGHEST, 0.4),
        admissible=lambda theta, c: bool(
            0.0 < c[0] < 0.8 and 2.5 < theta[0] < 38.0 and theta[1] < 0.35
        ),
        usual=lambda theta: theta[0] < HIGHEST_MOUNT,
    )


def table_term(rows: TrackerRows) -> Term | None:
    """How far the table rides on the base, where the tracker stands on the floor.

    The motion of the base is that of the force's mode with its mass ratio, so one number is left.
    """
    own = rows.found('base_resonance')
    known = own or rows.found('structural_resonance')
    if rows.rests or not known or known['frequency'] > HIGHEST:
        return None
    mounts = known['frequency'], known['damping']

    def base(paths: list[Array]) -> Array:
        swung = [carried_mass(q - q[0], rows.period, *mounts) for q in paths]
        return known['mass_ratio'] * rows.along(rows.smooth_at_points(swung))

    low, high = (0.0, BASE_SHARE) if own else (1.0 / ON_THE_FLOOR, ON_THE_FLOOR)
    return Term(
        constant(base(rows.calm_encoder())),
        lambda theta, c: {**mode(mounts, np.zeros(1)), 'floor_share': float(c[0])},
        admissible=lambda theta, c: bool(low < c[0] < high),
        answer=constant(base(rows.encoder_noise())),
        misread=rows.misread,
    )
