"""Section of a contour page: what an axis does when it turns back."""

from __future__ import annotations

import numpy as np

from stage_core import topics
from stage_core.pages import Page
from stage_core.session import Session
from stage_reports import figures
from stage_reports.figures.hysteresis import Loop, loop_of
from stage_reports.tracking import Run, Tracking


def hysteresis_section(page: Page, session: Session, run: Run, seen: list[Tracking]) -> None:
    """Draw force and table against motor over the position, for one run."""
    loops = [*_play(session, run, seen), *_force(session, run, seen)]
    loops = [loop for loop in loops if len(np.unique(loop.direction)) == 2]
    if not loops:
        return
    page.heading('Hysteresis')
    page.figure(
        figures.hysteresis_loops(loops),
        f'What each axis does forwards and backwards, run {run.number}',
        'Table minus motor: branches that stay apart up to both ends show play, by its width. A '
        'gap in the middle that closes at the ends comes from axes that are not square, or from '
        'a clock of the tracker that is off. A wave alike in both directions comes from the '
        'screw. Force: the branches lie apart by twice the friction, and their tilt is the mass. '
        'A column of points outside the branches is the start or the end of the run.',
    )


def _play(session: Session, run: Run, seen: list[Tracking]) -> list[Loop]:
    sensors = {tracking.sensor: tracking for tracking in seen}
    if not {'encoder', 'tracker'} <= sensors.keys():
        return []
    encoder = sensors['encoder']
    tracker = sensors['tracker'].take(run.within(sensors['tracker'].seconds))
    loops = []
    for k, axis in enumerate(session.axes):
        motor = np.interp(tracker.seconds, encoder.seconds, encoder.measured[:, k])
        speed = np.gradient(tracker.reference[:, k]) if len(motor) > 1 else np.zeros(len(motor))
        loops.append(loop_of(axis, False, motor, tracker.measured[:, k] - motor, speed))
    return loops


def _force(session: Session, run: Run, seen: list[Tracking]) -> list[Loop]:
    encoder = next((t for t in seen if t.sensor == 'encoder'), None)
    if encoder is None or not session.has(topics.COMMAND):
        return []
    series, seconds = session.series[topics.COMMAND], session.seconds(topics.COMMAND)
    inside = run.within(seconds)
    loops = []
    for k, axis in enumerate(session.axes):
        column = series.values.get(f'effort.{axis}')
        if column is None or inside.sum() < 2:
            continue
        at = seconds[inside]
        position = np.interp(at, encoder.seconds, encoder.measured[:, k])
        speed = np.gradient(np.interp(at, encoder.seconds, encoder.reference[:, k]))
        loops.append(loop_of(axis, True, position, column[inside], speed))
    return loops
