"""What to measure next, where the data leave a question open."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from gap_diagnosis.diagnose import Diagnosis
from stage_core.quantities import UNKNOWN, split_effect

#: Pair of effects (sorted) -> the experiment that separates them.
SEPARATES: dict[tuple[str, str], str] = {
    ('actuation_delay', 'structural_resonance'): 'a frequency sweep beyond the suspected '
    'resonance (to 150 Hz): a delay turns the phase without a peak of the amplitude',
    ('backlash', 'cyclic_pitch_error'): 'the same positions approached from both sides: play '
    'changes sign with the direction, a pitch error does not',
    ('coulomb_friction', 'stribeck_friction'): 'constant-speed strokes from 0.1 to 20 mm/s: only '
    'Stribeck friction falls with speed',
    ('asymmetric_friction', 'coulomb_friction'): 'strokes of equal speed in both directions '
    'with the force averaged over whole screw turns',
    ('asymmetric_friction', 'force_offset'): 'reversals within a few micrometres: an offset stays '
    'constant while friction builds up',
    ('scale_error', 'thermal_expansion'): 'the same grid cold and warm (temperature apart by at '
    'least 3 K): a scale error does not change',
    ('angular_error', 'scale_error'): 'the same line along the axis at two far coordinates of '
    'the other axis: only yaw changes the slope',
    ('nonorthogonality', 'tracker_misalignment'): 'lines along both axes: squareness turns only '
    'one of them in the tracker frame',
    ('tracker_clock_drift', 'tracker_latency'): 'the same fast stroke at the beginning and at the '
    'end of a session of 10 minutes: a latency stays the same',
    ('drive_gain', 'inertia_mismatch'): 'a known mass on the table, or strokes at constant high '
    'speed: viscous friction does not depend on the mass',
    ('force_saturation', 'inertia_mismatch'): 'the same stroke at two accelerations: saturation '
    'acts only on the fast one',
}  # fmt: skip

REFERENCE_FILE = 'next_reference.csv'


def steps(diagnosis: Diagnosis) -> list[str]:
    """Sentences for the user, the most useful first."""
    found = []
    for cause in diagnosis.causes:
        if cause.status != 'accepted':
            continue
        for rival in cause.alternatives:
            pair = sorted((split_effect(cause.effect)[0], split_effect(rival)[0]))
            how = SEPARATES.get((pair[0], pair[1]), 'a session with more reversals and speeds')
            found.append(f'{cause.effect} or {rival}: these data cannot tell. Measure {how}.')
    if UNKNOWN in diagnosis.verdict:
        worst = diagnosis.conditions[0] if diagnosis.conditions else None
        goes = f'; it goes with {worst.name} of axis {worst.axis}' if worst else ''
        found.append(
            'Structure remains that no effect of the library explains'
            f'{goes}. Repeat the session as it is: what repeats is the machine, the rest is not.'
        )
    if found:
        found.append(f'{REFERENCE_FILE} beside this page holds a reference that excites this.')
    if not found:
        found.append('Nothing: run the corrected twin, and diagnose again after a change.')
    return found


def needed(diagnosis: Diagnosis) -> bool:
    """Whether a further experiment would answer an open question."""
    return UNKNOWN in diagnosis.verdict or any(
        c.alternatives for c in diagnosis.causes if c.status == 'accepted'
    )


def write_reference(diagnosis: Diagnosis, directory: Path) -> None:
    """Write the next experiment's reference: t [s] and a position [m] per axis.

    Strokes from both sides at speeds from creeping to fast, short reversals, and a sweep, one
    axis after the other, within the travel of the diagnosed session.
    """
    if not needed(diagnosis):
        return
    record = diagnosis.records[0]
    centre = 0.5 * (record.encoder.min(axis=0) + record.encoder.max(axis=0))
    half = 0.4 * np.ptp(record.encoder, axis=0)
    step = 0.01
    shape = _stroke_shape(step)
    rows = np.tile(centre, (len(shape) * len(record.axes), 1))
    for i in range(len(record.axes)):
        rows[i * len(shape) : (i + 1) * len(shape), i] += half[i] * shape
    time = np.arange(len(rows)) * step
    np.savetxt(
        directory / REFERENCE_FILE,
        np.column_stack([time, rows]),
        delimiter=',',
        header=','.join(['t', *record.axes]),
        comments='',
        fmt='%.9g',
    )


def _stroke_shape(step: float) -> np.ndarray:
    """Relative position of one axis: smooth strokes, each slower than the last, then a sweep."""
    pieces = []
    at = 0.0
    for target, length in (
        (1, 1.0),
        (-1, 1.0),
        (1, 2.0),
        (-1, 4.0),
        (-0.9, 3.0),
        (-1, 3.0),
        (0, 2),
    ):
        s = np.arange(0.0, length, step) / length
        pieces.append(at + (target - at) * s**3 * (10.0 - 15.0 * s + 6.0 * s**2))
        pieces.append(np.full(int(0.5 / step), float(target)))
        at = float(target)
    t = np.arange(0.0, 12.0, step)
    pieces.append(0.1 * np.sin(2.0 * np.pi * (0.2 * t + 0.15 * t**2)) * np.sin(np.pi * t / 12.0))
    return np.concatenate(pieces)
