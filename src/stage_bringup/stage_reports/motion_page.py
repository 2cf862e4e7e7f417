"""Page of any other recording: the error of a moving stage, with its spectrum and map."""

from __future__ import annotations

import numpy as np

from stage_core import topics
from stage_core.pages import Page
from stage_core.session import Session
from stage_core.wording import scaled, with_interval
from stage_reports import figures
from stage_reports.intervals import distance_rms, path_interval
from stage_reports.sections import (
    axis_table,
    circular_section,
    condition_entries,
    positioning_section,
    recorded_section,
    temperature_section,
)
from stage_reports.tracking import Tracking, tracking_errors

#: Arrows along a path lie close; more of them cover each other.
ARROWS = 120


def motion_page(session: Session) -> Page:
    """Page of a session that has neither rests nor contour errors."""
    page = Page('The stage in motion')
    found = tracking_errors(session)
    if found:
        # The tracker sees the table, the encoder the motor.
        seen = found[-1]
        page.headline(
            with_interval(distance_rms(seen.errors), *path_interval(seen.errors)),
            f'RMS distance between the reference and the {seen.sensor} at every instant. The lag '
            'of the servo loop in motion is part of it.',
        )
    else:
        page.headline(
            'no error can be stated',
            'The recording lacks a reference, or a sensor in metres at its times.',
            warn=True,
        )
    page.conditions(condition_entries(session))
    if found:
        page.heading('Deviation from the reference')
        page.figure(
            figures.deviation_over_time(
                [(t.sensor, t.seconds, -t.errors) for t in found], session.axes
            ),
            'Measured minus reference over time',
            'A deviation that grows with the speed is the lag of the loop. Jumps at rest are '
            'errors of reversal. A constant one of the tracker alone shows a tracker that is not '
            'aligned.',
        )
    if len(session.axes) == 2 and session.has(topics.REFERENCE):
        reference = session.series[topics.REFERENCE].columns('position', session.axes)
        paths = [('reference', reference), *((t.sensor, t.measured) for t in found)]
        page.heading('The path')
        page.figure(
            figures.path_plot(paths),
            'Reference and measured path',
            'Where the stage went. Small deviations do not show here; they are drawn above.',
        )
    for tracking in found:
        _tracking(page, session, tracking)
    for tracking in found:
        positioning_section(page, session, tracking)
        circular_section(page, tracking)
    temperature_section(page, session)
    recorded_section(page, session)
    return page


def _tracking(page: Page, session: Session, tracking: Tracking) -> None:
    axes = session.axes
    page.heading(f'Tracking error, {tracking.sensor}')
    axis_table(page, tracking.errors, axes, f'reference minus {tracking.sensor}')
    factor, unit = scaled(float(np.abs(tracking.errors).max()), 'm')
    named = {axis: tracking.errors[:, k] * factor for k, axis in enumerate(axes)}
    period = float(np.median(np.diff(tracking.seconds)))
    if period > 0.0:
        page.figure(
            figures.spectrum(named, 1.0 / period, unit),
            f'Spectrum of the tracking error, {tracking.sensor}',
            'A line comes from a resonance, or from the screw at constant speed. A flat floor is '
            'noise.',
        )
    if len(axes) == 2:
        page.figure(
            figures.error_map(tracking.reference, -tracking.errors, arrows=ARROWS),
            f'Where the {tracking.sensor} sees the table off its reference',
            'Arrows along the path are the lag of the loop. Arrows across it are errors of the '
            'contour.',
        )
