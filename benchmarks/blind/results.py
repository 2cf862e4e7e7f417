"""The scores of a blind run as a Markdown page."""

from __future__ import annotations

from typing import Any

from benchmarks.rows import table

Scores = dict[str, Any]

#: Key of a score -> how it is called, and its target.
FIGURES = {
    'exact': ('exact set', '≥ 0.80'),
    'top1': ('top-1 (cases with a cause)', '≥ 0.90'),
    'probability_of_true': ('mean probability of a true cause', '≥ 0.80'),
    'false_naming': ('false naming on `none` and outside cases', '≤ 0.05'),
    'false_naming_anywhere': ('a false name in any case', ''),
    'unknown_said': ('`unknown` said where it is the answer', ''),
    'shrink_difference_points': ('shrinkage, predicted − achieved [points]', '≤ 5'),
    'seconds': ('wall time of a diagnosis [s]', ''),
}
HEADLINE = ('exact', 'top1', 'probability_of_true', 'false_naming', 'unknown_said')


def markdown(result: Scores) -> str:
    """The whole page."""
    parts = [
        f'{result["seeds"].capitalize()} seeds; code {result["commit"]}; truth sha256 '
        f'`{result["sha256"]}`; command:',
        f'    python -m benchmarks.blind.run {result["command"]}',
        'Mean [95 % interval] (number of cases).',
    ]
    suites: dict[str, Scores] = result['suites']
    if 'main' in suites:
        parts += _main(suites['main'])
    others = {n: s for n, s in suites.items() if n not in ('main', 'leave_one_out')}
    if others:
        parts += ['### Other sessions', _overview(others)]
    if 'leave_one_out' in suites:
        rows = [r for r in result['cases'] if r['suite'] == 'leave_one_out']
        parts += ['### Leave one effect out of the library', _left_out(suites, rows)]
    parts += ['### Every case that was missed', _missed(result['cases'])]
    return '\n\n'.join(parts) + '\n'


def value(figure: dict[str, float]) -> str:
    """A mean with its interval and count."""
    if not figure.get('count'):
        return '–'
    digits = 1 if abs(figure['high']) > 1.5 else 2
    return (
        f'{figure["mean"]:.{digits}f} [{figure["low"]:.{digits}f}, '
        f'{figure["high"]:.{digits}f}] ({figure["count"]})'
    )


def _main(scores: Scores) -> list[str]:
    figures = [[label, value(scores[key]), aim] for key, (label, aim) in FIGURES.items()]
    kinds = [[kind, value(figure)] for kind, figure in scores['exact_by_kind'].items()]
    bins = [
        [f'{b["from"]:.2f}–{b["to"]:.2f}', f'{b["stated"]:.3f}', value(b['true'])]
        for b in scores['calibration']
    ]
    beside = [
        [name, value(s['exact']), value(s['top1']), value(s['false_naming'])]
        for name, s in scores['baselines'].items()
    ]
    diagnosis = [
        'the diagnosis', value(scores['exact']), value(scores['top1']),
        value(scores['false_naming']),
    ]  # fmt: skip
    return [
        '### Main suite',
        table(['', 'result', 'target'], figures),
        table(['kind of case', 'exact set'], kinds),
        '#### Beside baselines',
        table(['', 'exact set', 'top-1', 'false naming'], [diagnosis, *beside]),
        '#### Calibration',
        table(['stated probability', 'mean stated', 'true'], bins),
        '#### Confusion matrix',
        'Cases with one cause or none: the truth in rows, what was named (over all axes) in '
        'columns.',
        _confusion(scores['confusion']),
    ]


def _confusion(counts: dict[str, dict[str, int]]) -> str:
    named = sorted({name for row in counts.values() for name in row})
    rows = [[t, *(str(row.get(n, '')) for n in named)] for t, row in counts.items()]
    return table(['', *named], rows)


def _overview(suites: dict[str, Scores]) -> str:
    rows = [
        [name, str(s['cases']), *(value(s[key]) for key in HEADLINE)] for name, s in suites.items()
    ]
    return table(['suite', 'cases', *(FIGURES[key][0] for key in HEADLINE)], rows)


def _left_out(suites: dict[str, Scores], rows: list[Scores]) -> str:
    lines = [
        [
            ', '.join(r['planted']) or 'below the noise',
            ', '.join(r['without']),
            ', '.join(r['verdict']) or 'none',
            'yes' if r['exact'] else '',
        ]
        for r in rows
    ]
    scores = suites['leave_one_out']
    return (
        f'The answer must be `unknown`. Exactly that: {value(scores["exact"])}; `unknown` said: '
        f'{value(scores["unknown_said"])}; another effect named: '
        f'{value(scores["false_naming"])}.\n\n'
        + table(['planted', 'out of the library', 'verdict', 'exact'], lines)
    )


def _missed(rows: list[Scores]) -> str:
    lines = [
        [
            f'{r["suite"]} {r["number"]}',
            r['kind'],
            ', '.join(r['expected']) or 'none',
            ', '.join(r['verdict']) or 'none',
        ]
        for r in rows
        if not r['exact']
    ]
    return table(['case', 'kind', 'truth', 'verdict'], lines) if lines else 'None.'
