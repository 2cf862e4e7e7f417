"""Page of several recordings of one motion: the error of each."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from contour_ctrl.reinforcement import LearningRate
from stage_core import topics
from stage_core.errors import StageError
from stage_core.metrics import Metrics
from stage_core.pages import Page
from stage_core.quantities import MICROMETRE
from stage_core.session import Session
from stage_core.wording import measure
from stage_reports import figures
from stage_reports.intervals import distance_rms
from stage_reports.tracking import Tracking, tracking_errors

SENSORS = ('encoder', 'tracker', 'contour')


def trials_page(sessions: Sequence[Session]) -> Page:
    """Page of several sessions as trials of one motion: errors over the trials.

    Raises
    ------
    StageError
        If they share no error.
    """
    tracked = [tracking_errors(session) for session in sessions]
    curves: dict[str, list[float]] = {}
    rows: list[list[object]] = []
    for number, (session, found) in enumerate(zip(sessions, tracked, strict=True), 1):
        errors = {item.sensor: item.errors for item in found}
        if session.has(topics.CONTOUR_ERROR):
            errors['contour'] = session.series[topics.CONTOUR_ERROR].values['z'][:, None]
        row: list[object] = [number, Path(session.path).name]
        for name in SENSORS:
            if name in errors:
                curves.setdefault(name, []).append(distance_rms(errors[name]))
            row.append(f'{curves[name][-1] / MICROMETRE:.2f}' if name in errors else None)
        rows.append(row)
    complete = {name: curve for name, curve in curves.items() if len(curve) == len(sessions)}
    if not complete:
        raise StageError(
            'the sessions share no error to compare: record the reference and an encoder, '
            'a tracker or the contour error in each'
        )
    page = Page(f'{len(sessions)} trials of one motion')
    name = 'contour' if 'contour' in complete else next(iter(complete))
    first, last = complete[name][0], complete[name][-1]
    page.headline(
        f'{measure(first)} to {measure(last)}',
        f'RMS error by the {name} in the first and in the last of {len(sessions)} trials.',
    )
    page.heading('Error of each trial')
    page.figure(
        figures.convergence(complete),
        'RMS error over the trials',
        'The curve falls until only what does not repeat from trial to trial is left.',
    )
    _regulated_rates(page, sessions[0].axes, tracked)
    page.table(['trial', 'recording', *(f'{s} RMS (µm)' for s in SENSORS)], rows)
    return page


def _regulated_rates(page: Page, axes: tuple[str, ...], tracked: list[list[Tracking]]) -> None:
    """Draw what the reinforcement regulator makes of the errors of these trials.

    It is run again on the RMS errors of each axis with its default settings; the recording does
    not say which rate was used.
    """
    if not all(tracked):
        return
    curves: dict[str, list[float]] = {}
    for column, axis in enumerate(axes):
        regulator = LearningRate()
        for trial in tracked:
            rate = regulator.after(Metrics.of(trial[0].errors[:, column]).rms)
            curves.setdefault(f'rate of {axis}', []).append(rate)
            curves.setdefault(f'reward of {axis}', []).append(regulator.reward)
    page.figure(
        figures.learning_rate(curves),
        'Learning rate and reward that the regulator derives from these errors',
        'Computed again with default settings. The recording does not hold the rate in use.',
    )
