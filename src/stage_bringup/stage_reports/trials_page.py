"""Page of several recordings of one motion: the error of each."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from stage_core.arrays import Array
from stage_core.errors import StageError
from stage_core.pages import Page
from stage_core.quantities import MICROMETRE
from stage_core.session import Session
from stage_core.wording import measure, with_interval
from stage_reports import figures
from stage_reports.intervals import distance_rms, path_interval, rms_interval
from stage_reports.sections import condition_entries
from stage_reports.tracking import places, runs, tracking_errors

#: What a recording shows, the figure of the headline first, in words.
ERRORS = {
    'contour': 'contour error, without approach and pauses',
    'rests': 'distance between wanted and measured position at rest',
    'encoder': 'distance between reference and encoder, the lag of the loop included',
    'tracker': 'distance between reference and tracker, the lag of the loop included',
}


def trials_page(sessions: Sequence[Session]) -> Page:
    """Page of several sessions as trials of one motion: errors over the trials.

    Raises
    ------
    StageError
        If they share no error.
    """
    trials = [_errors(session) for session in sessions]
    shared = [name for name in ERRORS if all(name in errors for errors in trials)]
    if not shared:
        raise StageError(
            'the sessions share no error to compare: record the reference and an encoder, '
            'a tracker or the contour error in each'
        )
    rms = {name: [distance_rms(errors[name]) for errors in trials] for name in shared}
    page = Page(f'{len(sessions)} trials of one motion')
    name, last = shared[0], trials[-1][shared[0]]
    interval = rms_interval if name == 'rests' else path_interval
    page.headline(
        with_interval(rms[name][-1], *interval(last)),
        f'RMS {ERRORS[name]}, in the last of {len(sessions)} trials. '
        f'In the first it was {measure(rms[name][0], digits=2)}.',
    )
    paths = [Path(session.path) for session in sessions]
    alike = len({path.name for path in paths}) < len(paths)
    names = ['/'.join(path.parts[-2:]) if alike else path.name for path in paths]
    page.conditions(condition_entries(sessions[0], [('Recording', ', '.join(names))]))
    page.heading('Error of each trial')
    page.figure(
        figures.convergence(rms, 'trial'),
        'RMS error over the trials',
        'A fall shows that something learns, down to what does not repeat from trial to trial. A '
        'rise by more than the interval above shows that the machine has changed.',
    )
    page.table(
        ['trial', 'recording', *(f'{kind} RMS (µm)' for kind in shared)],
        [
            [k + 1, names[k], *(f'{rms[kind][k] / MICROMETRE:.2f}' for kind in shared)]
            for k in range(len(sessions))
        ],
    )
    return page


def _errors(session: Session) -> dict[str, Array]:
    """Errors (n, axes) [m] of what counts in a session, by the keys of `ERRORS`."""
    followed = runs(session)
    if followed:
        return {'contour': np.concatenate([run.contour for run in followed])[:, None]}
    rests = places(session)
    if rests is not None:
        return {'rests': rests.errors}
    return {item.sensor: item.errors for item in tracking_errors(session)}
