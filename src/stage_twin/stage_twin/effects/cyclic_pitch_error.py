"""Wobble and eccentricity of the screw."""

from __future__ import annotations

import math

import numpy as np

from stage_twin.effects.definition import Effect, Parameter
from stage_twin.effects.rows import TrackerRows
from stage_twin.effects.shared import PERIOD, PHASE, screw_angle
from stage_twin.effects.term import Term, constant

EFFECT = Effect(
    name='cyclic_pitch_error',
    link='kinematic',
    parameters=(Parameter('amplitude', 'm', 0.0, 200e-6, 3e-6, 'amplitude'), PERIOD, PHASE),
    model='amplitude * sin(2 pi p / period + phase) along the axis: wobble and eccentricity of '
    'the screw. ISO 230-2:2014, intra-pitch deviation; Slocum, "Precision machine design" (1992).',
    sentence='the table swings by {amplitude} with each turn of the screw',
    excited_by='positions within several turns of the screw',
)


def along(motor: float, amplitude: float, period: float, phase: float, lead: float) -> float:
    """Displacement of the table along the axis [m]."""
    return amplitude * math.sin(screw_angle(motor, period, lead) + phase)


def term(rows: TrackerRows) -> Term:
    """Sine and cosine over the lead."""
    angles = [2.0 * np.pi * p / rows.lead for p in rows.position()]
    return Term(
        constant(rows.along([np.column_stack([np.sin(a), np.cos(a)]) for a in angles])),
        lambda theta, c: {
            'amplitude': float(np.hypot(c[0], c[1])),
            'phase': float(np.arctan2(c[1], c[0])),
        },
        admissible=lambda theta, c: float(np.hypot(c[0], c[1])) < 200e-6,
        nuisances=(0, 1),
        phase=True,
    )
