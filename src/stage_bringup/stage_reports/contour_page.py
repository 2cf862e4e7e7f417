"""Page of a contour session: the contour error run by run, without approach and pauses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calibrator.model_file import StoredModel
from stage_core.arrays import Array
from stage_core.metrics import Metrics
from stage_core.pages import Page
from stage_core.quantities import MICROMETRE
from stage_core.session import Session
from stage_core.wording import measure, span, with_interval
from stage_reports import figures
from stage_reports.extract import CircularPaths, circular_paths
from stage_reports.figures.contours import Run as Curve
from stage_reports.hysteresis_section import hysteresis_section
from stage_reports.intervals import STRETCHES, path_interval
from stage_reports.sections import (
    circular_section,
    circular_test,
    condition_entries,
    recorded_section,
    temperature_section,
)
from stage_reports.tracking import Run, Tracking, tracking_errors

MICRO = 1.0 / MICROMETRE
#: A run that leaves more than this share of the RMS before it has hardly lowered it.
WORTH = 0.95


def contour_page(
    session: Session,
    found: list[Run],
    model: StoredModel | None = None,
    entries: list[tuple[str, str]] | None = None,
) -> Page:
    """Page of a session with a contour.

    Parameters
    ----------
    found : its runs, see `tracking.runs`.
    model : that corrected the contour; its prediction of the reference is where the table should
        be. None takes the reference.
    """
    sensors = {item.sensor: item for item in tracking_errors(session)}
    seen = [sensors[s] for s in ('encoder', 'tracker') if s in sensors]
    # A stepper counts the steps of its motor.
    motor = 'encoder' if 'encoder' in sensors else 'motor'
    found, other = _by_way(found, seen)
    rms = [Metrics.of(run.contour).rms for run in found]
    best = int(np.argmin(rms))
    table = seen[-1] if seen and seen[-1].sensor == 'tracker' else None
    if table is not None and model is not None:
        table = replace(table, reference=np.asarray(model.model.predict(table.reference)))
    deviation = _table_deviation(found, table)
    page = Page('Following a contour')
    first = f' In the first run it was {measure(rms[0], digits=2)}.' if best else ''
    page.headline(
        with_interval(rms[best], *path_interval(found[best].contour)),
        f'RMS contour error in run {best + 1} of {len(found)}: the distance of the {motor} from '
        f'the wanted path, without approach and pauses.{first}',
        f'from the contour at the {motor}, RMS of the best run'
        f'{"" if deviation is None else f"; table: G {measure(deviation, digits=2)}"}',
    )
    page.conditions(
        [
            *condition_entries(session, entries),
            ('Place', _place(found[0], seen)),
            ('Runs', _count(found, other)),
        ]
    )
    page.items(
        [
            *_largest(found[best], seen),
            *_more_runs(rms),
            *([] if deviation is None else [_table_says(motor, deviation)]),
            f'The interval says how much the RMS depends on single stretches of the path (block '
            f'bootstrap of {STRETCHES} stretches).',
        ]
    )
    _learning(page, found, rms)
    _over_path(page, found, best, seen)
    _standard(page, found, other, table or (seen[0] if seen else None))
    _table(page, found, motor == 'encoder')
    hysteresis_section(page, session, found[best], seen)
    temperature_section(page, session)
    recorded_section(page, session)
    return page


def _count(found: list[Run], other: list[Run]) -> str:
    said = f'{len(found)} of {found[0].seconds[-1] - found[0].seconds[0]:.2f} s each'
    return f'{said}, {len(other)} the other way round' if other else said


def _by_way(found: list[Run], seen: list[Tracking]) -> tuple[list[Run], list[Run]]:
    """Runs of the way round a circle that was followed most, numbered anew, and of the other."""
    ways = [_paths(run, seen[0]) if seen else None for run in found]
    clockwise = [paths is not None and paths.counter_clockwise is None for paths in ways]
    most = 2 * sum(clockwise) > len(found)
    mine, others = (
        [run for run, way in zip(found, clockwise, strict=True) if (way == most) is kept]
        for kept in (True, False)
    )
    return [replace(run, number=number) for number, run in enumerate(mine, 1)], others


def _table_deviation(found: list[Run], table: Tracking | None) -> float | None:
    """Circular deviation G of the last run by the tracker [m]; None where it saw no circle."""
    if table is None:
        return None
    test = circular_test(table.take(found[-1].within(table.seconds)))
    return None if test is None else test[0].G


def _table_says(motor: str, deviation: float) -> str:
    return (
        f'The {motor} does not see play, pitch and squareness. The tracker sees the table: by it '
        f'the circular deviation G of the last run is {measure(deviation, digits=2)} (ISO 230-4).'
    )


def _largest(run: Run, seen: list[Tracking]) -> list[str]:
    """The largest error of a run, and at which angle of the circle."""
    said = f'The largest error is {measure(Metrics.of(run.contour).max, digits=2)}'
    circle = _circle(run, seen[0]) if seen else None
    points = _places(run, seen[0]) if seen else None
    if circle is None or points is None:
        return [f'{said}.']
    x, y = points[int(np.argmax(np.abs(run.contour)))] - circle[0]
    return [f'{said}, at {np.degrees(np.arctan2(y, x)) % 360.0:.0f}° of the circle.']


def _more_runs(rms: list[float]) -> list[str]:
    """Whether the error still falls from run to run."""
    if len(rms) < 2:
        return []
    if min(rms) < rms[-1]:
        return [f'Run {int(np.argmin(rms)) + 1} was the best. The runs after it did not help.']
    before, last = rms[-2:]
    change = f'{100.0 * abs(1.0 - last / before):.0f} %' if before > 0.0 else '0 %'
    told = 'another one may lower it further' if last < WORTH * before else 'more runs hardly help'
    return [f'The last run lowered the RMS by {change}: {told}.']


def _place(run: Run, seen: list[Tracking]) -> str:
    """Where the circle lies on the stage, and its radius; empty for another contour."""
    circle = _circle(run, seen[0]) if seen else None
    if circle is None:
        return ''
    (x, y), radius = circle
    centre = ', '.join(
        f'{axis} {span(1e3 * at, 1e3 * at, "mm", 1)}'
        for axis, at in zip('xy', (x, y), strict=True)
    )
    return f'circle, radius {measure(radius)}, centre {centre}'


def _learning(page: Page, found: list[Run], rms: list[float]) -> None:
    largest = [Metrics.of(run.contour).max for run in found]
    page.heading('Better from run to run')
    if len(found) > 1:
        page.figure(
            figures.convergence({'RMS': rms, 'largest': largest}),
            'Contour error over the runs',
            'The curves fall until only what does not repeat is left. A rise shows that the '
            'learning is too fast.',
        )
    ends = [found[0], found[-1]] if len(found) > 1 else found
    page.figure(
        figures.histogram({f'run {run.number}': run.contour for run in ends}, rare=True),
        'How often which contour error occurs',
        'Long tails beside a narrow heap are short events, such as the reversals of an axis.',
    )


def _places(run: Run, tracking: Tracking) -> Array | None:
    """Reference points (n, 2) [m] of a run, on the instants of its contour errors."""
    inside = run.within(tracking.seconds)
    if tracking.reference.shape[1] != 2 or inside.sum() < 8:
        return None
    seconds, points = tracking.seconds[inside], tracking.reference[inside]
    return np.column_stack([np.interp(run.seconds, seconds, column) for column in points.T])


def _over_path(page: Page, found: list[Run], best: int, seen: list[Tracking]) -> None:
    if not seen:
        return
    chosen = [found[0]] if best == 0 else [found[0], found[best]]
    circle = _circle(found[0], seen[0])
    curves: list[Curve] = []
    for run in chosen:
        points = _places(run, seen[0])
        if points is None:
            return
        if circle is None:
            steps = np.diff(points, axis=0, prepend=points[:1])
            place = 1e3 * np.cumsum(np.linalg.norm(steps, axis=1))
        else:
            offset = points - circle[0]
            place = np.degrees(np.unwrap(np.arctan2(offset[:, 1], offset[:, 0])))
        curves.append((f'run {run.number}', place, run.contour))
    label = 'way along the path (mm)' if circle is None else 'angle of the path (°)'
    page.heading('Where on the path')
    page.figure(
        figures.error_over_path(curves, label),
        'Contour error over the path, first and best run',
        'On a circle an axis reverses at 0°, 90°, 180° and 270°. Spikes there come from friction '
        'or play, a wave between them from the pitch of the screw or a ripple of the force.',
        curves=True,
    )
    if circle is not None:
        page.figure(
            figures.contour_polar(
                [(name, np.radians(place), error) for name, place, error in curves], circle[1]
            ),
            'The same on the circle, magnified',
            'Spikes stand where an axis reverses. An ellipse shows unequal gains of the axes, or '
            'axes that are not square.',
        )


def _paths(run: Run, tracking: Tracking) -> CircularPaths | None:
    part = tracking.take(run.within(tracking.seconds))
    if part.reference.shape[1] != 2 or len(part.reference) < 16:
        return None
    return circular_paths(part.reference, part.measured)


def _circle(run: Run, tracking: Tracking) -> tuple[Array, float] | None:
    paths = _paths(run, tracking)
    return None if paths is None else (paths.centre, paths.radius)


def _table(page: Page, found: list[Run], encoder: bool) -> None:
    """Figures of each run; those of the axes where the encoder speaks in metres."""
    header = ['run', 'contour RMS (µm)', 'contour largest (µm)']
    if encoder:
        header += [f'encoder: RMS of {axis} (µm)' for axis in 'xy']
    rows: list[list[object]] = []
    for run in found:
        f = Metrics.of(run.contour)
        row: list[object] = [run.number, f'{f.rms * MICRO:.2f}', f'{f.max * MICRO:.1f}']
        if encoder:
            row += [f'{Metrics.of(column).rms * MICRO:.2f}' for column in run.errors.T]
        rows.append(row)
    page.heading('Each run')
    page.table(header, rows, 'while the contour is followed')
    page.text(
        f'{"The encoder sits on the motor side: it" if encoder else "The motor"} does not see '
        'play, screw pitch and axes that are not square. Where a calibration corrects the '
        'contour, the reference holds the correction.'
    )


def _standard(page: Page, found: list[Run], other: list[Run], seen: Tracking | None) -> None:
    """ISO 230-4 of the first run of each way; of the last run where there is one way only.

    The tracker sees the table. The encoder leaves the circle by the calibration's correction.
    """
    if seen is None:
        return
    if not other:
        circular_section(page, seen.take(found[-1].within(seen.seconds)), 'last run')
        return
    both = found[0].within(seen.seconds) | other[0].within(seen.seconds)
    circular_section(page, seen.take(both), 'first run of each direction')
