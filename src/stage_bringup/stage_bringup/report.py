"""The report of a session: table, pictures, and a page for each bag."""

from __future__ import annotations

from pathlib import Path

from session_bags.reader import read_session
from stage_bringup.graph import Options
from stage_bringup.steps import SessionResult
from stage_core.quantities import MICROMETRE
from stage_reports import figures
from stage_reports.report import Report
from stage_reports.session_report import session_report


def write_report(options: Options, result: SessionResult) -> Path:
    """Write ``report.html`` and its PNG pictures into the session's folder; its path."""
    report = Report(f'Session {options.out.name}')
    report.text(
        f'Backend {options.backend}, {options.clock} clock, seed {options.seed}. Errors are those '
        'of the table position that the tracker measures, at points that no model was trained on.'
    )
    report.heading('Errors before and after the correction')
    names = [f'{n} {w}' for w in ('before', 'after') for n in ('RMS', 'MAE', 'max', 'σ')]
    report.table(
        ['µm, k = 1', *names],
        [
            [
                row.name,
                *(
                    value / MICROMETRE
                    for f in (row.before, row.after)
                    for value in (f.rms, f.mae, f.maximum, f.sigma)
                ),
            ]
            for row in result.rows
        ],
    )
    report.figure(
        figures.error_map(result.targets, result.before, result.after),
        'Error at the held-out points, before and after',
    )
    report.heading('What each step found')
    for line in result.lines:
        report.text(line)
    report.heading('Pages')
    for name, bag in result.bags.items():
        page = session_report(read_session(bag))
        page.save(options.out / f'{name}.html')
        report.text(f'{name}.html: the recorded session {name}, with its standard tests')
        # One picture of each bag is worth having on the first page.
        caption, figure = page.figures[0]
        report.figure(figure, f'{name}: {caption}')
    if (options.out / 'diagnosis' / 'report.html').exists():
        report.text('diagnosis/report.html: where the nominal twin and this machine differ')
    for number, (_, figure) in enumerate(report.figures):
        figure.savefig(options.out / f'picture_{number + 1}.png', dpi=110, bbox_inches='tight')
    return report.save(options.out / 'report.html')
