"""What to measure next, where the data leave a question open."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from gap_diagnosis.diagnose import Diagnosis
from gap_diagnosis.input.checks import EXCITATION_HINT
from stage_core.quantities import UNKNOWN
from stage_core.whole_file import write_whole
from stage_twin.effects import effect_of, separating

REFERENCE_FILE = 'next_reference.yaml'
SHARE_OF_TRAVEL, POINTS = 0.4, 240


def steps(diagnosis: Diagnosis) -> list[str]:
    """Sentences for the user, the most useful first."""
    found = []
    for cause in diagnosis.causes:
        if cause.status != 'accepted':
            continue
        for rival in cause.alternatives:
            if cause.effect == UNKNOWN:
                found.append(
                    f'{rival} would explain the force; the loop swings by it at a phase that no '
                    f'run of the twin repeats. Measure {effect_of(rival).excited_by}.'
                )
                continue
            how = separating(cause.effect, rival)
            found.append(f'{cause.effect} or {rival}: these data cannot tell. Measure {how}.')
    if UNKNOWN in diagnosis.verdict:
        worst = diagnosis.conditions[0] if diagnosis.conditions else None
        goes = f'; it goes with {worst.name} of axis {worst.axis}' if worst else ''
        found.append(
            'Structure remains that no effect of the library explains'
            f'{goes}. Repeat the session as it is: what repeats is the machine, the rest is not.'
        )
    if found and len(diagnosis.records[0].axes) == 2:
        found.append(
            f'{REFERENCE_FILE} beside this page is a contour that passes every place in both '
            'directions: run it with contour_ctrl (contour freeform, curve_file) at a slow and at '
            'a fast feed.'
        )
    elif found:
        found.append(f'Or {EXCITATION_HINT}.')
    if not found:
        found.append('Nothing: run the corrected twin, and diagnose again after a change.')
    return found


def needed(diagnosis: Diagnosis) -> bool:
    """Whether a further experiment would answer an open question."""
    return UNKNOWN in diagnosis.verdict or any(
        c.alternatives for c in diagnosis.causes if c.status == 'accepted'
    )


def write_reference(diagnosis: Diagnosis, directory: Path) -> Path | None:
    """Write the next experiment as a closed curve that `contour_ctrl` reads (`curve_file`).

    A Lissajous figure of three to four periods in the middle of the diagnosed travel: every
    position is passed in both directions, both axes reverse many times, each at several places of
    the other one, and the axes' speeds go through zero. None where no question is open, or where
    one axis alone was recorded: a contour has two.
    """
    record = diagnosis.records[0]
    if not needed(diagnosis) or len(record.axes) != 2:
        return None
    centre = 0.5 * (record.encoder.min(axis=0) + record.encoder.max(axis=0))
    half = SHARE_OF_TRAVEL * np.ptp(record.encoder, axis=0)
    # An axis that stood still has to move a little, else the figure has cusps.
    half = np.maximum(half, 0.1 * half.max())
    points = centre + half * _figure(POINTS)
    path = directory / REFERENCE_FILE
    lines = [
        '# The next experiment, a curve in metres. At two feeds, slow and fast, run:',
        '#   ros2 run contour_ctrl contour_ctrl --ros-args -p contour:=freeform \\',
        f'#     -p curve_file:={path} -p reduce_feed:=true -p feed:=0.01',
        'closed: true',
        'points:',
        *(f'- [{x:.9f}, {y:.9f}]' for x, y in points),
    ]
    write_whole(path, '\n'.join(lines) + '\n')
    return path


def _figure(count: int) -> np.ndarray:
    """Lissajous figure (count, 2) within ±1; its phase keeps the speed away from zero."""
    u = 2.0 * np.pi * np.arange(count) / count
    return np.column_stack([np.sin(3.0 * u + 0.25 * np.pi), np.sin(4.0 * u)])
