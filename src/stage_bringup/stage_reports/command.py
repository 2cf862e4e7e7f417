"""Page of recorded sessions: ``ros2 run stage_reports report --bag BAG --out DIR``."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from calibrator.model_file import StoredModel, load
from session_bags.reader import read_session
from stage_core.errors import command_line
from stage_core.pages import Page
from stage_core.session import Session
from stage_reports.calibration_page import calibration_page
from stage_reports.contour_page import contour_page
from stage_reports.motion_page import motion_page
from stage_reports.positioning_page import positioning_page, positioning_tests
from stage_reports.tracking import places, runs
from stage_reports.trials_page import trials_page


def session_page(
    session: Session,
    model: StoredModel | None = None,
    entries: list[tuple[str, str]] | None = None,
) -> Page:
    """The page that fits a session: contour, positioning test, calibration, any other motion.

    Parameters
    ----------
    model : trained from a calibration session, or active while a contour was followed.
    entries : further conditions that the recording does not know.
    """
    found = runs(session)
    if found:
        return contour_page(session, found, model, entries)
    tested = positioning_tests(session)
    if tested is not None:
        return positioning_page(session, *tested, entries)
    rests = places(session)
    if rests is not None:
        return calibration_page(session, rests, model, entries)
    return motion_page(session)


@command_line
def main(arguments: list[str] | None = None) -> int:
    """Write report.html and its pictures."""
    parser = argparse.ArgumentParser(prog='report', description=__doc__)
    parser.add_argument(
        '--bag', action='append', required=True, help='session; several are trials in this order'
    )
    parser.add_argument(
        '--model', help='model file that was trained from this session or corrected its contour'
    )
    parser.add_argument('--out', required=True, help='folder for report.html and the pictures')
    chosen = parser.parse_args(arguments)
    sessions = [read_session(path) for path in chosen.bag]
    model = load(Path(chosen.model)) if chosen.model else None
    page = session_page(sessions[0], model) if len(sessions) == 1 else trials_page(sessions)
    folder = Path(chosen.out)
    written = page.save(folder / 'report.html')
    page.save_pictures(folder, 'figure')
    print(f'wrote {written} with {len(page.figures)} pictures')
    return 0


if __name__ == '__main__':
    sys.exit(main())
