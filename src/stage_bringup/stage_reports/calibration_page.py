"""Page of a calibration session: the errors of the table at rest, and what a model leaves."""

from __future__ import annotations

import numpy as np

from calibrator.model_file import StoredModel
from stage_core.arrays import Array
from stage_core.pages import Page
from stage_core.session import Session
from stage_core.wording import span, with_interval, with_std
from stage_reports import figures
from stage_reports.intervals import distance_rms, rms_interval
from stage_reports.sections import (
    axis_table,
    condition_entries,
    positioning_section,
    recorded_section,
    temperature_section,
)
from stage_reports.tracking import Places, tracking_errors


def calibration_page(
    session: Session,
    rests: Places,
    model: StoredModel | None = None,
    entries: list[tuple[str, str]] | None = None,
) -> Page:
    """Page of a session with rests.

    Parameters
    ----------
    rests : of the session, see `tracking.places`.
    model : trained from this session; what it would leave at the same places is drawn beside.
    entries : further conditions.
    """
    errors = rests.errors
    page = Page('The table at rest')
    page.headline(
        with_interval(distance_rms(errors), *rms_interval(errors)),
        f'RMS distance between wanted and measured position at {len(errors)} rests, before any '
        'correction. What the stage does between the rests does not count.',
        'at rest, before the correction',
    )
    where = ', '.join(
        f'{axis} {span(low, high, "mm")}'
        for axis, low, high in zip(
            session.axes,
            rests.wanted.min(axis=0) * 1e3,
            rests.wanted.max(axis=0) * 1e3,
            strict=True,
        )
    )
    page.conditions(
        [
            *condition_entries(session, entries),
            ('Places', f'{len(errors)} rests, {where}'),
            *([] if model is None else [('Domain of the model', model.domain_line())]),
            *([('Drift', model.drift)] if model is not None and model.drift else []),
        ]
    )
    left = None if model is None else errors - predicted_errors(model, rests)
    _map(page, session, rests, left)
    _over_axes(page, session, rests, left)
    for tracking in tracking_errors(session):
        if tracking.sensor == 'tracker':
            positioning_section(page, session, tracking)
    temperature_section(page, session)
    recorded_section(page, session)
    return page


def predicted_errors(model: StoredModel, rests: Places) -> Array:
    """Errors (n, axes) [m] that a model predicts at the places of a session."""
    return np.asarray(model.model.predict(rests.wanted, rests.direction)) - rests.wanted


def _map(page: Page, session: Session, rests: Places, left: Array | None) -> None:
    if len(session.axes) != 2:
        return
    page.heading('Where the table is off')
    title = 'Errors at the rests, and what the model leaves of them'
    page.figure(
        figures.error_map(rests.wanted, rests.errors, left),
        'Errors at the rests' if left is None else title,
        'Arrows that turn about a point show axes that are not square, or a tracker frame that '
        'is turned. Arrows that flip between neighbours show play or the pitch of the screw.',
    )
    if left is not None:
        page.text(
            'The map after is an offline prediction. No correction was applied while this was '
            'recorded, and the model was trained on most of these places. What the correction '
            'achieves is measured at other places, on the page of the session.'
        )


def _over_axes(page: Page, session: Session, rests: Places, left: Array | None) -> None:
    errors = rests.errors
    page.heading('Error of each axis')
    for column, axis in enumerate(session.axes):
        error, toward = errors[:, column], rests.direction[:, column]
        page.figure(
            figures.error_over_axis(rests.wanted[:, column], error, toward, axis),
            f'Error of {axis} by the direction of approach',
            f'Two branches a constant apart show play as it is at rest, here '
            f'{_gap(error, toward)}, the dashed lines. A servo that overshoots takes play up '
            'before it rests. A slope shows an error of scale.',
        )
    page.figure(
        figures.histogram({axis: errors[:, k] for k, axis in enumerate(session.axes)}),
        'How often which error occurs',
        'One heap about zero is noise. Two heaps show an error that depends on the direction. A '
        'heap beside zero shows an offset.',
    )
    axis_table(page, errors, session.axes, 'measured minus wanted, before correction')
    if left is not None:
        axis_table(page, left, session.axes, 'what the model leaves (prediction)')


def _gap(error: Array, toward: Array) -> str:
    """Mean difference between the two directions, with its standard deviation, in words."""
    up, down = error[toward > 0], error[toward < 0]
    if min(len(up), len(down)) < 2:
        return 'unknown (one direction only)'
    std = float(np.sqrt(up.var(ddof=1) / len(up) + down.var(ddof=1) / len(down)))
    gap = float(up.mean() - down.mean())
    return f'{with_std(gap, std)} (1 σ) between the means'
