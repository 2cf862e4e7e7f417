"""Page of a positioning test by ISO 230-2."""

from __future__ import annotations

import numpy as np

from stage_core.pages import Page
from stage_core.session import Session
from stage_core.wording import with_std
from stage_reports.extract import PositioningRuns
from stage_reports.iso230 import positioning
from stage_reports.sections import (
    axis_tests,
    condition_entries,
    positioning_section,
    recorded_section,
    temperature_section,
)
from stage_reports.tracking import Tracking, tracking_errors
from stage_reports.uncertainty import positioning_uncertainty

#: Fewer targets than the standard asks for are no test of their own.
FEWEST_TARGETS = 5
#: Targets within this (m) are one place that a correction moved a little.
SHORTEST_TRAVEL = 1e-3
Tests = dict[str, PositioningRuns]


def positioning_tests(session: Session) -> tuple[Tracking, Tests] | None:
    """The axes that were tested by ISO 230-2, by the tracker; None where there is none."""
    for tracking in tracking_errors(session):
        if tracking.sensor != 'tracker':
            continue
        tests = {
            axis: test
            for axis, test in axis_tests(session, tracking).items()
            if len(test.targets) >= FEWEST_TARGETS and np.ptp(test.targets) >= SHORTEST_TRAVEL
        }
        if tests:
            return tracking, tests
    return None


def positioning_page(
    session: Session,
    tracking: Tracking,
    tests: Tests,
    entries: list[tuple[str, str]] | None = None,
) -> Page:
    """Page of a session that tests its axes; `tests` as of `positioning_tests`."""
    page = Page('Positioning of each axis')
    said = []
    for axis, test in tests.items():
        accuracy = positioning(test.targets, test.up, test.down).A
        said.append(f'{axis} {with_std(accuracy, positioning_uncertainty(test)["A"])}')
    page.headline(
        f'A: {", ".join(said)}',
        'Bidirectional accuracy A by ISO 230-2: the band that holds every position of the axis, '
        'with its expanded uncertainty (k = 2) from the scatter of the tracker.',
        'bidirectional accuracy by ISO 230-2',
    )
    counts = {
        axis: f'{len(t.targets)} with {t.up.shape[1]} approaches from each side'
        for axis, t in tests.items()
    }
    alike = len(set(counts.values())) == 1
    count = ', '.join(f'{axis}: {text}' for axis, text in counts.items())
    page.conditions(
        [
            *condition_entries(session, entries),
            ('Targets', f'on each axis {next(iter(counts.values()))}' if alike else count),
        ]
    )
    positioning_section(page, session, tracking)
    temperature_section(page, session)
    recorded_section(page, session)
    return page
