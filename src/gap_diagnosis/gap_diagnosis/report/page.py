"""report.html: the diagnosis on one self-contained page."""

from __future__ import annotations

import html
from pathlib import Path

from gap_diagnosis.diagnose import Diagnosis
from gap_diagnosis.evidence import experiments
from gap_diagnosis.evidence.judgement import Cause
from gap_diagnosis.report import document as report
from gap_diagnosis.report import figures
from stage_twin.effects import effect_of

STYLE = """
body{font:15px/1.5 system-ui,sans-serif;max-width:62rem;margin:2rem auto;padding:0 1rem;color:#222}
h1{font-size:1.3rem}h2{font-size:1.1rem;margin-top:2rem}
.verdict{font-size:1.15rem;background:#eef4fb;border-left:5px solid #1f77b4;padding:.7rem 1rem}
table{border-collapse:collapse;width:100%}td,th{border-bottom:1px solid #ddd;padding:.25rem .5rem;
text-align:left;vertical-align:top}td.n{text-align:right;white-space:nowrap}img{max-width:100%}
.accepted{background:#eaf6ea}
"""


def render(diagnosis: Diagnosis) -> str:
    """The page as text."""
    parts = [
        '<h1>Where the twin and the machine differ</h1>',
        f'<p class="verdict">{_text(report.sentence(diagnosis))}</p>',
        _found(diagnosis),
        _summary(diagnosis),
        '<h2>The gap before and after, on data that no fit has seen</h2>',
        _channels(diagnosis),
        _image(figures.time_series(diagnosis), 'gap over time'),
        _image(figures.spectra(diagnosis), 'spectra of the gap'),
        '<h2>Where it lies</h2>',
        _where(diagnosis),
        _image(figures.heat_map(diagnosis), 'gap over the workspace'),
        _image(figures.shares(diagnosis), 'share by condition'),
        '<h2>Evidence for each candidate</h2>',
        _causes(diagnosis),
        _contains(diagnosis),
        '<h2>What to do next</h2>',
        _next(diagnosis),
    ]
    body = '\n'.join(parts)
    return (
        '<!doctype html><html lang="en"><head><meta charset="utf-8">'
        f'<title>Gap diagnosis</title><style>{STYLE}</style></head><body>{body}</body></html>\n'
    )


def write(diagnosis: Diagnosis, directory: Path) -> None:
    """Write report.html."""
    (directory / 'report.html').write_text(render(diagnosis), encoding='utf-8')


def _text(value: object) -> str:
    return html.escape(str(value))


def _image(uri: str, what: str) -> str:
    return f'<p><img alt="{_text(what)}" src="{uri}"></p>'


def _row(cells: list[object], kind: str = 'td', style: str = '') -> str:
    inner = ''.join(
        f'<{kind}{" class=n" if isinstance(c, (int, float)) else ""}>'
        f'{c if isinstance(c, (int, float)) else _text(c)}</{kind}>'
        for c in cells
    )
    return f'<tr class="{style}">{inner}</tr>'


def _table(head: list[object], rows: list[str]) -> str:
    return f'<table>{_row(head, "th")}{"".join(rows)}</table>'


def _found(diagnosis: Diagnosis) -> str:
    """What each accepted effect means on this machine."""
    items = ''.join(
        f'<li>{_text(cause.effect)}: {_text(_meaning(cause))}.</li>'
        for cause in diagnosis.causes
        if cause.status == 'accepted' and cause.parameters
    )
    return f'<ul>{items}</ul>' if items else ''


def _meaning(cause: Cause) -> str:
    values = {name: value for name, (value, _) in cause.parameters.items()}
    return effect_of(cause.effect).says(values)


def _summary(diagnosis: Diagnosis) -> str:
    names = _text(', '.join(diagnosis.sessions))
    notes = ''.join(f'<br>Note: {_text(w)}.' for w in diagnosis.warnings)
    return (
        f'<p>Session {names}; twin {_text(diagnosis.twin_name)}. The gap counts the position '
        f'channels on {len(diagnosis.windows)} held-out windows. Unexplained above the noise '
        f'floor: {100 * diagnosis.unexplained:.1f} % of the squared gap, '
        f'{"with structure" if diagnosis.structured else "without structure"}.{notes}</p>'
    )


def _channels(diagnosis: Diagnosis) -> str:
    rows = []
    for name, channel in diagnosis.channels.items():
        factor, unit = (1.0, 'N') if channel.unit == 'N' else (1e6, 'µm')
        before, after = factor * channel.rms('before'), factor * channel.rms('after')
        shrink = 100.0 * (1.0 - after / before) if before > 0.0 else 0.0
        rows.append(_row([name, f'{before:.3g} {unit}', f'{after:.3g} {unit}', f'{shrink:.0f} %']))
    return _table(['channel', 'before (RMS)', 'after (RMS)', 'shrinks by'], rows)


def _where(diagnosis: Diagnosis) -> str:
    axes = ', '.join(f'{a} {100 * s:.0f} %' for a, s in diagnosis.axes_share.items())
    return f'<p>Link: <b>{_text(diagnosis.link)}</b>. Share of the axes: {_text(axes)}.</p>'


def _parameters(cause: Cause) -> str:
    return ', '.join(f'{n} = {v:.4g} ± {s:.1g}' for n, (v, s) in cause.parameters.items())


def _causes(diagnosis: Diagnosis) -> str:
    rows = []
    for cause in diagnosis.causes[:25]:
        accepted = cause.status == 'accepted' and bool(cause.parameters)
        low, high = cause.interval
        rows.append(
            _row(
                [
                    cause.effect,
                    f'{cause.probability:.3f}',
                    cause.status,
                    _parameters(cause),
                    f'{100 * cause.shrink:.1f} % [{100 * low:.0f}, {100 * high:.0f}]'
                    if accepted
                    else '',
                    ', '.join(cause.alternatives),
                ],
                style='accepted' if cause.status == 'accepted' else '',
            )
        )
    head: list[object] = [
        'effect', 'probability', 'status', 'parameters', 'closes [95 %]', 'cannot be told from',
    ]  # fmt: skip
    return _table(head, rows)


def _contains(diagnosis: Diagnosis) -> str:
    """What effects that hold special cases are made of."""
    parts = []
    for cause in diagnosis.causes:
        if not cause.contains:
            continue
        rows = []
        for rung in cause.contains:
            low, high = rung.interval
            values = ', '.join(f'{n} = {v:.4g} ± {s:.1g}' for n, (v, s) in rung.parameters.items())
            shrink = f'{100 * rung.shrink:.1f} % [{100 * low:.0f}, {100 * high:.0f}]'
            seen = 'yes' if rung.supported else 'no'
            style = 'accepted' if rung.supported else ''
            rows.append(_row([rung.effect, shrink, seen, values], style=style))
        parts.append(f'<h3>{_text(cause.effect)} contains, added one by one</h3>')
        parts.append(_table(['part', 'shrinks the rest by [95 %]', 'seen', 'parameters'], rows))
    return ''.join(parts)


def _next(diagnosis: Diagnosis) -> str:
    steps = experiments.steps(diagnosis)
    items = ''.join(f'<li>{_text(s)}</li>' for s in steps)
    return (
        f'<ul>{items}</ul><p><code>corrected_twin.yaml</code> beside this page is the nominal '
        'twin with the accepted effects; <code>stage_twin</code> runs it as it is.</p>'
    )
