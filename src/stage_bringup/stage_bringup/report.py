"""The pages of a session: its own, and one for each recording, linked with each other."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from calibrator import model_file
from gap_diagnosis.report.causes import CLOSES, closes_words, effect_sentence, parameter_words
from session_bags.reader import read_session
from stage_bringup.graph import Options, nominal_twin, reality_twin
from stage_bringup.steps import SessionResult
from stage_core.pages import Page, add_conditions, add_navigation
from stage_core.quantities import MICROMETRE, split_effect
from stage_core.wording import effect_words, measure, span, with_interval
from stage_reports import figures
from stage_reports.command import session_page
from stage_reports.intervals import distance_rms, rms_interval
from stage_reports.sections import heat_words
from stage_twin.effects import EFFECTS

Link = tuple[str, str, str]
#: Names of the pages beside the recordings that they are about.
TITLES = {'calibration': 'Calibration', 'circle': 'Contour', 'positioning': 'Positioning test'}


def write_report(options: Options, result: SessionResult) -> Path:
    """Write ``report.html``, the pages it links to, and its pictures as PNG; its path."""
    links = [(TITLES.get(name, name), f'{name}.html') for name in result.bags]
    diagnosis = options.out / 'diagnosis' / 'report.json'
    if diagnosis.exists():
        links.append(('Diagnosis', 'diagnosis/report.html'))
    entries = _conditions(options, result)
    cards: list[Link] = []
    for name, bag in result.bags.items():
        session = read_session(bag)
        # The positioning test comes before the calibration.
        told = [(n, v if (n, name) != ('Model', 'positioning') else '') for n, v in entries]
        page = session_page(session, _model(options), told)
        here = f'{name}.html'
        others = [(n, a if a != here else '') for n, a in links]
        page.navigation([('Session', 'report.html'), *others])
        page.save(options.out / here)
        cards.append((TITLES.get(name, name), here, page.brief))
    found = json.loads(diagnosis.read_text()) if diagnosis.exists() else None
    if found is not None:
        cards.append(('Diagnosis', 'diagnosis/report.html', _verdict(found)))
    page = _session_page(result, [*entries, ('Temperature', heat_words(session))], cards)
    page.navigation([('Session', ''), *links])
    if found is not None:
        _diagnosis(page, found)
        told = [(n, v) for n, v in entries if n in ('Machine', 'Model', 'Clock')]
        add_conditions(diagnosis.with_name('report.html'), told)
        back = [(n, '' if a.startswith('diagnosis') else f'../{a}') for n, a in links]
        add_navigation(diagnosis.with_name('report.html'), [('Session', '../report.html'), *back])
    _steps(page, result)
    page.save_pictures(options.out, 'picture')
    return page.save(options.out / 'report.html')


def _conditions(options: Options, result: SessionResult) -> list[tuple[str, str]]:
    return [
        ('Machine', f'emulated by {reality_twin(options).name}, {options.backend} drive'),
        ('Twin', nominal_twin(options).name),
        ('Model', options.method),
        ('Date', result.data['recorded'].replace('T', ' ')[:16]),
        ('Clock', f'{options.clock}, seed {options.seed}'),
    ]


def _model(options: Options) -> model_file.StoredModel | None:
    """The model that the session trained; None where it left none."""
    files = sorted((options.out / 'models').glob('model_*.json'))
    return model_file.load(files[-1]) if files else None


def _session_page(
    result: SessionResult, entries: list[tuple[str, str]], cards: list[Link]
) -> Page:
    before, after = result.before, result.after
    page = Page('A session: calibrate, follow a contour, diagnose')
    rms = distance_rms(after)
    shrinks = 100.0 * (1.0 - rms / distance_rms(before))
    page.headline(
        with_interval(rms, *rms_interval(after)),
        f'RMS distance between wanted and measured position after the correction, at '
        f'{len(after)} places that no model has seen. Before the correction it was '
        f'{measure(distance_rms(before), digits=2)}: {shrinks:.0f} % less.',
        warn=shrinks <= 0.0,
    )
    corner = ', '.join(
        f'{axis} {span(low, high, "mm")}'
        for axis, low, high in zip(
            'xy', result.targets.min(axis=0) * 1e3, result.targets.max(axis=0) * 1e3, strict=True
        )
    )
    page.conditions([*entries, ('Places', f'{len(after)}, {corner}')])
    page.cards(cards)
    page.heading('Before and after the correction')
    page.figure(
        figures.error_map(result.targets, before, after),
        'Error at the places that no model has seen, both at one scale',
        'Short arrows in all directions are noise. Where neighbours still point the same way '
        'after the correction, the model has missed something.',
    )
    page.table(
        ['error (µm)', 'RMS', 'mean |e|', 'largest', 'σ'],
        [
            [
                f'{row.name.removeprefix("held-out ")}, {when}',
                *(f'{v / MICROMETRE:.2f}' for v in (f.rms, f.mae, f.max, f.sigma)),
            ]
            for row in result.rows
            for when, f in (('before', row.before), ('after', row.after))
        ],
        'measured by the tracker, whose noise is part of every figure',
    )
    return page


def _verdict(report: dict[str, Any]) -> str:
    gap = report['gap']
    names = ', '.join(effect_words(name) for name in report['verdict']) or 'no cause named'
    return f'{names}: gap {measure(gap["before"], digits=2)} to {measure(gap["after"], digits=2)}'


def _diagnosis(page: Page, report: dict[str, Any]) -> None:
    gap, rows = report['gap'], []
    for cause in report['causes']:
        if cause['effect'] not in report['verdict']:
            continue
        known = split_effect(cause['effect'])[0] in EFFECTS
        values = {n: (p['value'], p['std']) for n, p in cause['parameters'].items()}
        rows.append(
            [
                effect_words(cause['effect']),
                f'{cause["probability"]:.2f}',
                effect_sentence(cause['effect'], values) if known else '',
                parameter_words(cause['effect'], values),
                closes_words(cause['shrink'], cause['shrink_ci95']),
            ]
        )
    page.heading('Where the twin and the machine differ')
    before, after, floor = (
        measure(gap[name], digits=2) for name in ('before', 'after', 'noise_floor')
    )
    page.text(
        f'The gap between the nominal twin and this machine is {before} RMS on stretches that no '
        f'fit has seen. With the effects below it is {after}; noise and resolution alone make '
        f'{floor}.'
    )
    if rows:
        page.table(
            ['effect', 'probability', 'what it does', 'parameters ± 1 σ', 'closes (95 %)'],
            rows,
            CLOSES,
        )


def _steps(page: Page, result: SessionResult) -> None:
    with page.folded('What each step said'):
        page.table(['step', 'message'], [line.split(': ', 1) for line in result.lines])
