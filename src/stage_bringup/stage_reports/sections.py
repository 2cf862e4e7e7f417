"""Sections that several pages share: conditions, standard tests, signals, what was recorded."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from stage_core import topics
from stage_core.arrays import Array
from stage_core.metrics import Metrics
from stage_core.pages import Page
from stage_core.session import Session
from stage_core.wording import date_words, measure, scaled, span, with_std
from stage_reports import figures
from stage_reports.extract import PositioningRuns, circular_paths, positioning_runs
from stage_reports.iso230 import Circular, circular, positioning
from stage_reports.tracking import Tracking
from stage_reports.uncertainty import positioning_uncertainty

#: Both directions of a circle; the second may not have been run.
Paths = tuple[Array, Array | None]
#: The figures of ISO 230-2 that a page shows, with their names in the standard.
POSITIONING_FIGURES = (
    ('A', 'accuracy, bidirectional'),
    ('R', 'repeatability, bidirectional'),
    ('R_up', 'repeatability, positive approach'),
    ('R_down', 'repeatability, negative approach'),
    ('E', 'systematic deviation, bidirectional'),
    ('B', 'reversal value'),
    ('M', 'mean deviation, bidirectional'),
)


def heat_words(session: Session) -> str:
    """The temperatures of a session; the electronics' where the stage has no sensor."""
    sensors = session.temperatures()
    stage = {name: s for name, s in sensors.items() if not name.startswith('controller')}
    values = [s.values['temperature'] for s in (stage or sensors).values()]
    if not values:
        return 'not recorded'
    told = span(min(v.min() for v in values), max(v.max() for v in values), '°C', 1)
    return told if stage else f'{told}, of the controller alone'


def condition_entries(
    session: Session, known: list[tuple[str, str]] | None = None
) -> list[tuple[str, str]]:
    """What is `known` of a session's conditions, and what it tells itself."""
    twin = session.twin
    told = {
        'Recording': Path(session.path).name,
        'Date': date_words(session.recorded_ns),
        'Twin': f'{twin.get("kind")}, in the recording' if twin else 'none in the recording',
        'Temperature': heat_words(session),
        'Alignment': 'tracker aligned with the stage' if session.alignment else '',
    }
    return list({**told, **dict(known or [])}.items())


def axis_tests(session: Session, tracking: Tracking) -> dict[str, PositioningRuns]:
    """The axes whose targets were approached from both sides, by ISO 230-2."""
    columns = zip(session.axes, tracking.reference.T, tracking.measured.T, strict=True)
    found = {axis: positioning_runs(tracking.seconds, *both) for axis, *both in columns}
    return {axis: test for axis, test in found.items() if test is not None}


def positioning_section(page: Page, session: Session, tracking: Tracking) -> None:
    """Evaluate the axes that were tested by ISO 230-2."""
    tests = axis_tests(session, tracking)
    if not tests:
        return
    page.heading(f'Positioning by ISO 230-2, {tracking.sensor}')
    values: dict[str, list[str]] = {name: [] for name, _ in POSITIONING_FIGURES}
    for axis, test in tests.items():
        result = positioning(test.targets, test.up, test.down)
        uncertain = positioning_uncertainty(test)
        page.figure(
            figures.positioning_plot(result, uncertain, f'axis {axis}'),
            f'Deviations of axis {axis} at {len(test.targets)} targets',
            'Bands that lie apart show play (B), wide bands poor repeatability (R). A servo that '
            'overshoots takes play up before it rests, so that B is smaller than the play. A '
            'slope is an error of scale, a wave comes from the screw. The bracket spans A. The '
            'bar beside its end is ± U, the expanded uncertainty of A (k = 2).',
        )
        for name, said in values.items():
            said.append(with_std(getattr(result, name), uncertain[name]))
    page.table(
        ['figure', 'meaning', *(f'{axis} ± U' for axis in tests)],
        [
            [name.replace('_up', '↑').replace('_down', '↓'), meaning, *values[name]]
            for name, meaning in POSITIONING_FIGURES
        ],
        'U: expanded uncertainty (k = 2) from the scatter of the sensor within the rests '
        'alone; its alignment, scale and the temperature are not in it',
    )
    for axis, test in tests.items():
        count = test.up.shape[1]
        if count < 5 or len(test.targets) < 5:
            page.text(
                f'{axis}: {len(test.targets)} targets with {count} approaches from each side. The '
                'standard asks for five of each.'
            )


def circular_test(tracking: Tracking) -> tuple[Circular, Paths, str] | None:
    """A circle by ISO 230-4, its paths (n, 2) [m] and the way of the first; None where none is."""
    if tracking.reference.shape[1] != 2:
        return None
    paths = circular_paths(tracking.reference, tracking.measured)
    if paths is None:
        return None
    first, second, way = paths.counter_clockwise, paths.clockwise, 'counter-clockwise'
    if first is None:
        first, second, way = second, None, 'clockwise'
    if first is None:
        return None
    return circular(first, second, paths.radius, paths.centre), (first, second), way


def circular_section(page: Page, tracking: Tracking, which: str = '') -> None:
    """Evaluate a circle by ISO 230-4, if there is one. `which` names the runs of it."""
    test = circular_test(tracking)
    if test is None:
        return
    result, (first, second), way = test
    values: list[tuple[str, str, float | None]] = [
        (f'G, {way}', 'circular deviation: width of the thinnest ring around the path', result.G),
        ('G, clockwise', 'the same of the other direction', result.G_clockwise),
        ('G(b)', 'the same of both directions together', result.G_b),
        ('H', 'largest difference of the two directions at one angle', result.H),
        ('F max', 'largest radial deviation', result.F_max),
        ('F min', 'smallest radial deviation', result.F_min),
        ('D', 'mean radius minus nominal radius', result.D),
    ]
    page.figure(
        figures.circular_plot(result, first, second),
        f'Circular test (ISO 230-4), {tracking.sensor}, radius {measure(result.radius)}'
        f'{which and f", {which}"}',
        'An ellipse along 45° shows axes that are not square. Steps at 0°, 90°, 180° and 270° '
        'show play or friction, waves the pitch of the screw.',
    )
    page.table(
        ['figure', 'meaning', 'value'],
        [[n, words, measure(v, digits=2)] for n, words, v in values if v is not None],
    )
    if second is None:
        page.text(
            f'The circle was followed {way} only. The standard asks for both directions, from '
            'which G(b) and H follow.'
        )


def temperature_section(page: Page, session: Session) -> None:
    """Draw the temperatures where any moved by a tenth of a degree."""
    sensors = {name: s for name, s in sorted(session.temperatures().items()) if len(s) > 1}
    if not any(np.ptp(s.values['temperature']) >= 0.1 for s in sensors.values()):
        return
    longest = max(sensors, key=lambda name: len(sensors[name]))
    seconds = session.seconds(topics.temperature_key(longest))
    # One axis of time for all; temperatures change slowly against their sampling.
    curves = {
        name: np.interp(
            seconds, session.seconds(topics.temperature_key(name)), s.values['temperature']
        )
        for name, s in sensors.items()
    }
    page.heading('Temperatures')
    page.figure(
        figures.time_series(seconds, curves, 'temperature (°C)'),
        f'Temperature of {", ".join(sensors)}',
        'A screw that warms grows by about 11 µm per metre and kelvin.',
    )


def recorded_section(page: Page, session: Session) -> None:
    """What the recording holds, folded away."""
    rows: list[list[object]] = []
    for topic in sorted(session.series):
        series = session.series[topic]
        if not len(series):
            continue
        length = float(series.stamps[-1] - series.stamps[0]) * 1e-9
        rate = f'{(len(series) - 1) / length:.4g}' if length > 0.0 else None
        rows.append([topic, len(series), f'{length:.1f}', rate])
    with page.folded('What was recorded'):
        page.table(['topic', 'messages', 'duration (s)', 'rate (Hz)'], rows)
        for warning in session.warnings:
            page.text(f'Note: {warning}')


def axis_table(page: Page, errors: Array, axes: tuple[str, ...], caption: str) -> None:
    """Tell RMS, mean |e|, largest and standard deviation of errors (n, axes) [m] of each axis."""
    factor, unit = scaled(float(np.abs(errors).max()), 'm')
    places = 2 if unit == 'µm' else 4
    names = [f'{name} ({unit})' for name in ('RMS', 'mean |e|', 'largest', 'σ')]
    rows: list[list[object]] = []
    for column, axis in enumerate(axes):
        f = Metrics.of(errors[:, column])
        values = (f.rms, f.mae, f.max, f.sigma)
        rows.append([axis, *(f'{v * factor:.{places}f}' for v in values)])
    page.table(['axis', *names], rows, caption)
