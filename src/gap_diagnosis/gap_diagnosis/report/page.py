"""report.html: the diagnosis on one self-contained page."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np

from gap_diagnosis.evidence.acceptance import shrink_interval
from gap_diagnosis.report import experiment, figures, forces, hysteresis, model, response
from gap_diagnosis.report.causes import causes_section, contained_section, found_section
from gap_diagnosis.report.laws import laws_section
from gap_diagnosis.report.leftovers import leftovers
from gap_diagnosis.report.words import link_words
from gap_diagnosis.result import Diagnosis
from stage_core.pages import Page
from stage_core.quantities import UNKNOWN
from stage_core.wording import date_words, effect_words, measure, span

#: A channel of fewer values is not drawn as a spectrum.
SPECTRUM = 64


def make(diagnosis: Diagnosis) -> Page:
    """The page of a diagnosis."""
    page = Page(f'Where the {_name(diagnosis)} and the machine differ')
    _headline(page, diagnosis)
    _conditions(page, diagnosis)
    found_section(page, diagnosis)
    if diagnosis.model is not None:
        model.section(page, diagnosis.model)
    _gap(page, diagnosis)
    _where(page, diagnosis)
    causes_section(page, diagnosis)
    contained_section(page, diagnosis)
    laws_section(page, diagnosis)
    forces.section(page, diagnosis)
    _next(page, diagnosis)
    return page


def render(diagnosis: Diagnosis) -> str:
    """The page as text."""
    return make(diagnosis).render()


def write(diagnosis: Diagnosis, directory: Path) -> None:
    """Write report.html."""
    make(diagnosis).save(directory / 'report.html')


def _name(diagnosis: Diagnosis) -> str:
    """What the machine is compared with."""
    return 'simulator' if diagnosis.simulators else 'twin'


def _headline(page: Page, diagnosis: Diagnosis) -> None:
    before, after = diagnosis.before, diagnosis.after
    floor = f'Noise and resolution alone make {measure(diagnosis.noise_floor, digits=2)}.'
    if not diagnosis.verdict:
        rests = ''
        if not diagnosis.rests_as_stated:
            rests = (
                'A stated friction holds or gives way at rest otherwise on the machine: the gap '
                f'of a twin that rests so is {measure(after, digits=2)}. '
            )
        page.headline(
            f'no cause named, gap {measure(before, digits=2)} RMS',
            f'{rests}No effect of the library explains the gap between {_name(diagnosis)} and '
            f'machine better. {floor}',
        )
        return
    page.headline(
        f'gap {measure(before, digits=2)} → {measure(after, digits=2)} RMS, {_less(diagnosis)}',
        f'{_lacks(diagnosis)} The gap before and after these effects is that '
        f'of stretches of the session that no fit has seen. {floor}',
        warn=UNKNOWN in diagnosis.verdict,
    )


def _lacks(diagnosis: Diagnosis) -> str:
    """The accepted effects with their probabilities; apart, those that are rather not there."""
    sure = {cause.effect: cause.probability for cause in diagnosis.causes}
    likely = [name for name in diagnosis.verdict if sure.get(name, 1.0) >= 0.5]
    others = [name for name in diagnosis.verdict if name not in likely]
    named, doubted = (
        ', '.join(
            effect_words(name) + (f' ({sure[name]:.2f})' if name in sure else '') for name in names
        )
        for names in (likely, others)
    )
    said = [f'The {_name(diagnosis)} lacks (in brackets: probability) {named}.']
    if others:
        said.append(f'Kept, though its probability is below a half: {doubted}.')
    return ' '.join(said if likely else said[1:])


def _less(diagnosis: Diagnosis) -> str:
    """By how much the gap shrinks, with the interval."""
    sides = [c.sides(0.0) for c in diagnosis.channels.values() if c.unit == 'm']
    low, high = (100.0 * value for value in shrink_interval(sides, 0))
    # Not "-0 %".
    return f'{round(100.0 * diagnosis.shrink)} % less (95 %: {span(low, high, "%")})'


def _travel(diagnosis: Diagnosis) -> str:
    record = diagnosis.records[-1]
    ends = zip(record.axes, record.encoder.min(axis=0), record.encoder.max(axis=0), strict=True)
    return ', '.join(f'{axis} {span(1e3 * low, 1e3 * high, "mm")}' for axis, low, high in ends)


def _heat(diagnosis: Diagnosis) -> str:
    found = [r.temperature for r in diagnosis.records if r.temperature is not None]
    if not found:
        return 'not recorded'
    return span(min(t.min() for t in found), max(t.max() for t in found), '°C', 1)


def _unexplained(diagnosis: Diagnosis) -> str:
    left = 'with structure' if diagnosis.structured else 'without structure'
    events = ', with short events, see below' if leftovers(diagnosis) else ''
    return f'{100 * diagnosis.unexplained:.1f} % of the squared gap, {left}{events}'


def _conditions(page: Page, diagnosis: Diagnosis) -> None:
    page.conditions(
        [
            ('Recording', ', '.join(Path(name).name for name in diagnosis.sessions)),
            ('Twin', Path(diagnosis.twin_name).name),
            *(('Simulator', Path(name).name) for name in diagnosis.simulators),
            ('Recorded', date_words(diagnosis.started)),
            ('Diagnosed', time.strftime('%Y-%m-%d %H:%M')),
            ('Temperature', _heat(diagnosis)),
            ('Travel', _travel(diagnosis)),
            ('Judged on', f'{len(diagnosis.windows)} held-out windows'),
            ('Unexplained', _unexplained(diagnosis)),
        ]
    )
    if diagnosis.warnings:
        page.items([f'Note: {warning}.' for warning in diagnosis.warnings])


def _gap(page: Page, diagnosis: Diagnosis) -> None:
    page.heading('The gap before and after, on data that no fit has seen')
    rows: list[list[object]] = []
    for name, channel in diagnosis.channels.items():
        before, after = channel.rms('before'), channel.rms('after')
        shrink = 100.0 * (1.0 - after / before) if before > 0.0 else 0.0
        said = [measure(value, channel.unit) for value in (before, after)]
        rows.append([effect_words(name), *said, f'{shrink:.0f} %'])
    page.table(
        ['channel', 'before (RMS)', 'after (RMS)', 'shrinks by'],
        rows,
        'encoder and force: what the servo loop does with a command; tracker: where the table is '
        'at a given encoder reading',
    )
    page.figure(
        figures.time_series(diagnosis),
        'Gap over time',
        'Blue should look like noise: no steps, no slope, no spikes that come back at each '
        'reversal. A dotted line is where the next window begins.',
        curves=True,
    )
    _leftovers(page, diagnosis)
    _loop(page, diagnosis)
    # A handful of rests has no spectrum.
    if min(len(np.concatenate(c.before)) for c in diagnosis.channels.values()) >= SPECTRUM:
        page.figure(
            figures.spectra(diagnosis),
            'Spectra of the gap',
            'Blue should be flat. A line that stays in blue is a period that the twin lacks.',
            curves=True,
        )


def _loop(page: Page, diagnosis: Diagnosis) -> None:
    loops = hysteresis.hysteresis(diagnosis)
    if loops:
        page.figure(
            hysteresis.hysteresis_plot(loops),
            'Hysteresis of the gap: filled points forwards, open ones backwards',
            'Force branches that stay apart show friction: it is half their distance, and builds '
            'up over the first micrometres after a reversal. Tracker branches that stay apart '
            'show play. Blue should lie at zero in both directions.',
        )
    found = response.responses(diagnosis)
    if found:
        page.figure(
            response.response_plot(found),
            'Frequency response from reference to encoder, as far as the motion excites it',
            'The dashed machine should lie on blue. A peak that blue lacks is a resonance, and a '
            'phase that falls faster a delay. A magnitude that differs at all frequencies shows '
            'other gains or another mass.',
        )


def _leftovers(page: Page, diagnosis: Diagnosis) -> None:
    found = leftovers(diagnosis)
    if not found:
        return
    page.table(
        ['channel', 'events', 'largest', 'at (s)', 'soon after a reversal'],
        [
            [
                effect_words(item.channel),
                item.count,
                measure(item.largest, item.unit),
                ', '.join(f'{t:.2f}' for t in item.times),
                f'{item.after_reversal} of {item.count}',
            ]
            for item in found
        ],
        'what stands out of the rest by six standard deviations after the correction; times of '
        'the session, of which the picture shows the held-out windows only',
    )


def _where(page: Page, diagnosis: Diagnosis) -> None:
    page.heading('Where it lies')
    axes = ', '.join(f'{a} {100 * s:.0f} %' for a, s in diagnosis.axes_share.items())
    page.text(f'Most of the gap lies in {link_words(diagnosis.link)}. Shares of the axes: {axes}.')
    page.figure(
        figures.shares(diagnosis),
        'Which conditions the gap depends on',
        'Side of approach points to friction or play, the turn of the screw to its pitch, '
        'position to guides, scale and squareness, speed to viscous friction or latency, time '
        'and temperature to drift. Conditions go together, so the shares do not add up to 100 %. '
        'A grey bar may be chance (significance level 5 %).',
    )
    page.figure(
        figures.heat_map(diagnosis),
        'Gap over the workspace',
        'An even colour shows that the gap does not depend on the position. The map after should '
        'be dark.',
    )


def _next(page: Page, diagnosis: Diagnosis) -> None:
    page.heading('What to do next')
    experiment.section(page, diagnosis)
    steps = []
    found = leftovers(diagnosis)
    if found:
        worst = max(found, key=lambda item: item.largest)
        events = '1 short event' if worst.count == 1 else f'{worst.count} short events'
        steps.append(
            f'The {effect_words(worst.channel)} still has {events} of up to '
            f'{measure(worst.largest, worst.unit)}, {worst.after_reversal} soon after a reversal. '
            'Measure strokes in both directions at several speeds. Then diagnose with the '
            'corrected twin: what is left has the shape of the missing effect.'
        )
    elif diagnosis.experiment is None and UNKNOWN not in diagnosis.verdict:
        steps.append(_nothing(diagnosis))
    page.items(steps)
    page.text(
        '`corrected_twin.yaml` beside this page is the nominal twin with the accepted effects. '
        '`ros2 run stage_twin simulate --twin corrected_twin.yaml` runs it as it is.'
    )


def _nothing(diagnosis: Diagnosis) -> str:
    """What to do where no question is open: more than half of what is left may not be noise."""
    if diagnosis.after**2 <= 2.0 * diagnosis.noise_floor**2:
        return 'Nothing: run the corrected twin, and diagnose again after a change.'
    seen = 'and has structure' if diagnosis.structured else 'but no structure is seen in it'
    left, floor = (measure(v, digits=2) for v in (diagnosis.after, diagnosis.noise_floor))
    return (
        f'The gap that is left, {left}, is more than noise and resolution make ({floor}), {seen}. '
        'Repeat the session: what repeats is the machine, and the rest is how it scatters.'
    )
