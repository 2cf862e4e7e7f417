"""Report of recorded sessions: ``ros2 run stage_reports report --bag BAG --out DIR``."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from contour_ctrl.reinforcement import LearningRate
from session_bags.reader import read_session
from stage_core import topics
from stage_core.errors import StageError, command_line
from stage_core.metrics import error_figures
from stage_core.session import Session
from stage_reports import figures
from stage_reports.extract import circular_paths, positioning_runs
from stage_reports.iso230 import circular, positioning
from stage_reports.report import Report

Array = NDArray[np.float64]
MICRO = 1e6
#: A stage position beyond this (m) is not in metres: a stepper's joint states are motor steps.
LONGEST_STAGE = 20.0
#: Arrows along a path lie close; more of them cover each other.
ARROWS = 120
POSITIONING_FIGURES = (
    'A',
    'A_up',
    'A_down',
    'R',
    'R_up',
    'R_down',
    'B',
    'B_mean',
    'E',
    'E_up',
    'E_down',
    'M',
)


@dataclass
class Tracking:
    """Errors of a session at the instants of one sensor; arrays (n,) s and (n, axes) m."""

    sensor: str
    seconds: Array
    reference: Array
    measured: Array
    errors: Array = field(init=False)

    def __post_init__(self) -> None:
        self.errors = self.reference - self.measured


def _reference_at(session: Session, seconds: Array) -> Array:
    """Reference positions (n, axes) at the given times; NaN outside the reference."""
    series = session.require(topics.REFERENCE, 'says where the stage should be')
    times = session.seconds(topics.REFERENCE)
    columns = series.columns('position', session.axes)
    return np.column_stack(
        [np.interp(seconds, times, column, left=np.nan, right=np.nan) for column in columns.T]
    )


def tracking_errors(session: Session) -> list[Tracking]:
    """Tracking errors seen by the encoder and by the tracker, those that the session has."""
    found = []
    if session.has(topics.JOINT_STATES):
        series = session.series[topics.JOINT_STATES]
        measured = series.columns('position', session.axes)
        stepper = bool(session.twin) and (session.twin or {}).get('kind') == 'stepper'
        if not stepper and np.abs(measured).max() < LONGEST_STAGE:
            seconds = session.seconds(topics.JOINT_STATES)
            found.append(('encoder', seconds, measured))
    if session.has(topics.TRACKER_POINT):
        seconds = session.seconds(topics.TRACKER_POINT)
        found.append(('tracker', seconds, session.table_points()[:, : len(session.axes)]))
    result = []
    for sensor, seconds, measured in found:
        reference = _reference_at(session, seconds)
        known = np.isfinite(reference).all(axis=1)
        if known.sum() >= 8:
            result.append(Tracking(sensor, seconds[known], reference[known], measured[known]))
    return result


def _contents(report: Report, session: Session) -> None:
    rows: list[list[object]] = []
    for topic in sorted(session.series):
        series = session.series[topic]
        if not len(series):
            continue
        length = float(series.stamps[-1] - series.stamps[0]) * 1e-9
        rate = (len(series) - 1) / length if length > 0.0 else None
        rows.append([topic, len(series), length, rate])
    report.heading('What was recorded')
    report.table(['topic', 'messages', 'duration (s)', 'rate (Hz)'], rows)
    for warning in session.warnings:
        report.text(f'Note: {warning}')


def _tracking(report: Report, session: Session, tracking: Tracking) -> None:
    axes = session.axes
    report.heading(f'Tracking error, {tracking.sensor}')
    rows: list[list[object]] = []
    for column, axis in enumerate(axes):
        f = error_figures(tracking.errors[:, column])
        rows.append([axis, f.rms * MICRO, f.mae * MICRO, f.maximum * MICRO, f.sigma * MICRO])
    report.table(
        ['axis', 'RMS (µm)', 'mean |e| (µm)', 'largest (µm)', 'σ (µm)'],
        rows,
        f'reference minus {tracking.sensor}',
    )
    named = {axis: tracking.errors[:, k] * MICRO for k, axis in enumerate(axes)}
    report.figure(
        figures.time_series(tracking.seconds, named, 'error (µm)', 'tracking error'),
        f'Tracking error seen by the {tracking.sensor} over time',
    )
    period = float(np.median(np.diff(tracking.seconds)))
    if period > 0.0:
        report.figure(
            figures.spectrum(named, 1.0 / period, 'µm', 'spectrum of the tracking error'),
            f'Amplitude spectral density of the tracking error seen by the {tracking.sensor}',
        )
    if len(axes) == 2:
        report.figure(
            figures.error_map(tracking.reference, -tracking.errors, arrows=ARROWS),
            f'Where the {tracking.sensor} sees the table off its reference',
        )


def _standards(report: Report, session: Session, tracking: Tracking) -> None:
    for column, axis in enumerate(session.axes):
        runs = positioning_runs(
            tracking.seconds, tracking.reference[:, column], tracking.measured[:, column]
        )
        if runs is None:
            continue
        result = positioning(runs.targets, runs.up, runs.down)
        report.heading(f'Positioning of axis {axis} (ISO 230-2), {tracking.sensor}')
        report.table(
            ['figure', 'value (µm)'],
            [[name, getattr(result, name) * MICRO] for name in POSITIONING_FIGURES],
        )
        if runs.up.shape[1] < 5 or len(runs.targets) < 5:
            report.text(
                f'{len(runs.targets)} targets with {runs.up.shape[1]} approaches: the standard '
                'asks for five of each.'
            )
        report.figure(
            figures.positioning_plot(result, f'axis {axis}'),
            f'Positioning deviations of axis {axis}',
        )
    if len(session.axes) != 2:
        return
    paths = circular_paths(tracking.reference, tracking.measured)
    if paths is None:
        return
    first, second = paths.counter_clockwise, paths.clockwise
    label = 'counter-clockwise'
    if first is None:
        first, second, label = second, None, 'clockwise'
    if first is None:
        return
    outcome = circular(first, second, paths.radius, paths.centre)
    report.heading(f'Circular test (ISO 230-4), {tracking.sensor}')
    rows: list[list[object]] = [[f'G, {label}', outcome.G * MICRO]]
    if second is not None:
        rows += [
            ['G, clockwise', None if outcome.G_clockwise is None else outcome.G_clockwise * MICRO],
            ['G(b)', None if outcome.G_b is None else outcome.G_b * MICRO],
            ['H', None if outcome.H is None else outcome.H * MICRO],
        ]
    rows += [
        ['F max', outcome.F_max * MICRO],
        ['F min', outcome.F_min * MICRO],
        ['D', outcome.D * MICRO],
    ]
    report.table(['figure', 'value (µm)'], rows, f'radius {outcome.radius * 1e3:.4g} mm')
    report.figure(
        figures.circular_plot(outcome, first, second),
        'Radial deviation over the angle, magnified',
    )


def _signals(report: Report, session: Session) -> None:
    if session.has(topics.CONTOUR_ERROR):
        contour = session.series[topics.CONTOUR_ERROR].values['z']
        f = error_figures(contour)
        report.heading('Contour error')
        report.table(
            ['RMS (µm)', 'mean |e| (µm)', 'largest (µm)'],
            [[f.rms * MICRO, f.mae * MICRO, f.maximum * MICRO]],
        )
        report.figure(
            figures.time_series(
                session.seconds(topics.CONTOUR_ERROR),
                {'contour error': contour * MICRO},
                'error (µm)',
            ),
            'Contour error over time',
        )
    sensors = {name: s for name, s in sorted(session.temperatures().items()) if len(s) > 1}
    if sensors:
        longest = max(sensors, key=lambda name: len(sensors[name]))
        seconds = session.seconds(topics.temperature_key(longest))
        # One axis of time for all; temperatures change slowly against their sampling.
        curves = {
            name: np.interp(
                seconds, session.seconds(topics.temperature_key(name)), s.values['temperature']
            )
            for name, s in sensors.items()
        }
        report.heading('Temperatures')
        report.figure(
            figures.time_series(seconds, curves, 'temperature (°C)'),
            f'Temperature of {", ".join(sensors)}',
        )


def session_report(session: Session) -> Report:
    """Build the report of one session: contents, errors, standard tests, other signals."""
    report = Report(f'Session {Path(session.path).name}')
    _contents(report, session)
    if session.has(topics.REFERENCE) and len(session.axes) == 2:
        reference = session.series[topics.REFERENCE].columns('position', session.axes)
        paths = [('reference', reference)]
        tracking = tracking_errors(session)
        paths += [(item.sensor, item.measured) for item in tracking]
        report.heading('Path')
        report.figure(figures.path_plot(paths), 'Reference and measured path')
    else:
        tracking = tracking_errors(session) if session.has(topics.REFERENCE) else []
    if not tracking:
        report.text(
            'No error can be stated: the session lacks a reference, or a sensor in metres at its '
            'times.'
        )
    for item in tracking:
        _tracking(report, session, item)
    for item in tracking:
        _standards(report, session, item)
    _signals(report, session)
    return report


def trials_report(sessions: Sequence[Session]) -> Report:
    """Build the report of several sessions as trials of one motion: errors over the trials."""
    report = Report(f'{len(sessions)} trials')
    curves: dict[str, list[float]] = {}
    rows: list[list[object]] = []
    for number, session in enumerate(sessions, 1):
        row: list[object] = [number, Path(session.path).name]
        errors = {item.sensor: item.errors for item in tracking_errors(session)}
        if session.has(topics.CONTOUR_ERROR):
            errors['contour'] = session.series[topics.CONTOUR_ERROR].values['z'][:, None]
        for name in ('encoder', 'tracker', 'contour'):
            value = None
            if name in errors:
                value = float(np.sqrt((errors[name] ** 2).sum(axis=1).mean()))
                curves.setdefault(name, []).append(value)
            row.append(None if value is None else value * MICRO)
        rows.append(row)
    complete = {name: curve for name, curve in curves.items() if len(curve) == len(sessions)}
    if not complete:
        raise StageError(
            'the sessions share no error to compare: record the reference and an encoder, '
            'a tracker or the contour error in each'
        )
    report.heading('Convergence')
    report.figure(
        figures.convergence(complete, 'RMS error over the trials'), 'Error of each trial'
    )
    _regulated_rates(report, sessions)
    report.table(
        ['trial', 'session', 'encoder RMS (µm)', 'tracker RMS (µm)', 'contour RMS (µm)'], rows
    )
    return report


def _regulated_rates(report: Report, sessions: Sequence[Session]) -> None:
    """Draw what the reinforcement regulator makes of the errors of these trials.

    It is run again on the RMS errors of each axis with its default settings; the recording does
    not say which rate was used.
    """
    errors = [tracking_errors(session) for session in sessions]
    if not all(errors):
        return
    curves: dict[str, list[float]] = {}
    for column, axis in enumerate(sessions[0].axes):
        regulator = LearningRate()
        for trial in errors:
            rate = regulator.after(error_figures(trial[0].errors[:, column]).rms)
            curves.setdefault(f'rate of {axis}', []).append(rate)
            curves.setdefault(f'reward of {axis}', []).append(regulator.reward)
    report.heading('Tuning of the learning rate')
    report.figure(
        figures.learning_rate(curves, 'factor on the initial learning rate'),
        'Learning rate and reward that the regulator with default settings derives from the '
        'errors above',
    )


@command_line
def main(arguments: list[str] | None = None) -> int:
    """Write report.html and its pictures."""
    parser = argparse.ArgumentParser(prog='report', description=__doc__)
    parser.add_argument(
        '--bag', action='append', required=True, help='session; several are trials in this order'
    )
    parser.add_argument('--out', required=True, help='folder for report.html and the pictures')
    chosen = parser.parse_args(arguments)
    sessions = [read_session(path) for path in chosen.bag]
    report = session_report(sessions[0]) if len(sessions) == 1 else trials_report(sessions)
    folder = Path(chosen.out)
    page = report.save(folder / 'report.html')
    for number, (_, figure) in enumerate(report.figures, 1):
        figure.savefig(folder / f'figure_{number:02d}.png', dpi=110, bbox_inches='tight')
    print(f'wrote {page} with {len(report.figures)} pictures')
    return 0


if __name__ == '__main__':
    sys.exit(main())
