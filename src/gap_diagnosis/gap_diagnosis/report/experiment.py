"""The experiment of a report: its file, its entry in report.json, its section of the page."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from gap_diagnosis.experiment.design import Experiment
from gap_diagnosis.experiment.questions import LARGE
from gap_diagnosis.experiment.travel import FILE
from gap_diagnosis.result import Diagnosis
from stage_core.arrays import Array
from stage_core.pages import Page
from stage_core.quantities import UNKNOWN
from stage_core.whole_file import write_whole
from stage_core.wording import effect_words, parameter_name
from stage_twin.effects import effect_of

#: Of the table [s]: the contour controller takes a spline through it.
SPACING = 0.004
#: Effects that the session does not show, at most, of which the page says what is expected.
MOST = 8


def as_dict(experiment: Experiment) -> dict[str, Any]:
    """The entry `experiment` of report.json."""
    return {
        'separates': experiment.separates,
        'duration': experiment.duration,
        'expected': experiment.expected,
        'expected_before': experiment.before,
        'pairs': [
            {'candidates': list(names), 'before': before, 'expected': expected}
            for names, before, expected in experiment.pairs
        ],
        'library': [
            {'effect': name, 'before': before, 'expected': expected}
            for name, before, expected in experiment.library
        ],
        'motions': experiment.motions,
        'file': FILE,
    }


def write(experiment: Experiment, directory: Path) -> Path:
    """Write the motion as the contour controller reads it (contour `timed`)."""
    path = directory / FILE
    write_whole(path, table(experiment.position, experiment.period, experiment.axes))
    return path


def table(position: Array, period: float, axes: tuple[str, ...]) -> str:
    """Text of a motion (n, a) [m]: a row of time [s] and positions [m] every `SPACING`."""
    step = max(1, round(SPACING / period))
    rows = np.arange(0, len(position), step)
    lines = [','.join(('t', *axes))]
    for k in rows.tolist():
        numbers = ','.join(f'{v:.9f}' for v in position[k])
        lines.append(f'{k * period:.6f},{numbers}')
    return '\n'.join(lines) + '\n'


def _words(pair: Sequence[str]) -> str:
    """*nonorthogonality or angular error of x*, *the amplitude in backlash of x*, *backlash*."""
    if isinstance(pair, str):
        return effect_words(pair)
    name, _, size = pair[0].partition(': ')
    if tuple(pair[1:]) == (LARGE,):
        return f'the {parameter_name(size.removesuffix(" small"))} in {effect_words(name)}'
    return ' or '.join(map(effect_words, pair))


def section(page: Page, found: Diagnosis) -> None:
    """What to measure next, why, and what is expected of it."""
    for cause in found.causes:
        if cause.effect == UNKNOWN and cause.status == 'accepted':
            page.items(
                [
                    f'{rival} would explain the force; the loop swings by it at a phase that no '
                    f'run of the twin repeats. Measure {effect_of(rival).excited_by}.'
                    for rival in cause.alternatives
                ]
            )
    experiment = found.experiment
    if experiment is None:
        if UNKNOWN in found.verdict:
            page.text(
                'Structure remains that no effect of the library explains, and no two candidates '
                'that a motion could tell apart. Repeat the session as it is: what repeats is '
                'the machine, the rest is not.'
            )
        return
    if experiment.expected <= experiment.before:
        rows = [*experiment.pairs, *experiment.library]
        left = '; '.join(_words(names) for names, _, _ in rows)
        page.text(
            f'These data leave open: {left}. No motion that was tried within the limits is '
            'expected to decide it.'
        )
        return
    page.text(
        f'{_open(experiment)} Of the motions within the limits that were tried, this one of '
        f'{experiment.duration:.0f} s moves the predictions of the twin with each of them '
        f'furthest apart: {"; ".join(experiment.motions)}.'
    )
    shown = sorted(experiment.library, key=lambda row: row[1] - row[2])[:MOST]
    page.table(
        ['candidates', 'decided by this session', 'expected of the experiment'],
        [
            [_words(names), f'{100 * before:.0f} %', f'{100 * expected:.0f} %']
            for names, before, expected in [*experiment.pairs, *shown]
        ],
        'of two candidates: share of the machines with parameters within the intervals on which a '
        'diagnosis would prefer the right one; of one effect at a usual size: share of the other '
        'effects, and of none at all, from which a diagnosis would tell it',
    )
    page.text(
        f'`{FILE}` beside this page is the motion. `ros2 service call /gap_diagnosis/experiment '
        'std_srvs/srv/Trigger` has the stage run it, where the node allows motion, and diagnoses '
        'both sessions together.'
    )


def _open(experiment: Experiment) -> str:
    """What the session leaves open, in a sentence."""
    if experiment.pairs:
        names = ', '.join(effect_words(name) for name in experiment.separates)
        return f'These data cannot tell apart: {names}.'
    return (
        'This session does not show some effects of a usual size, or does not tell them from '
        'others.'
    )
