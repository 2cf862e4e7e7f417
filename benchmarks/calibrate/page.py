"""The page of the calibration, and the module with the fitted weights."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.calibrate.figures import coverage, near, unseen, verdicts, without_doubtful
from benchmarks.calibrate.sessions import GENERATORS
from benchmarks.calibrate.spread import Spread, spread_of, widened
from benchmarks.generators.score import bins
from benchmarks.rows import table
from gap_diagnosis.evidence.judgement import SERVO_STRUCTURE, TRACKER_STRUCTURE

Row = dict[str, Any]
Weights = dict[str, dict[str, float]]

#: What is stated from here on is meant to be relied on.
SURE = 0.9
HEAD = """# What the stated probabilities and intervals of the diagnosis are worth

`make calibrate-diagnosis` writes this page and the weights of the probabilities
(`src/gap_diagnosis/gap_diagnosis/evidence/calibrated.py`). The sessions come from three machines
that share no code: `own` is that of the blind suite (`benchmarks/blind`), `mujoco` and `handmade`
are those of `benchmarks/generators`. All seeds are development seeds.

The command is made for 300 sessions of each (`--sessions 300`). This page says how many there
were: figures of fewer than 30 cases say little.
"""
RULES = """A verdict is exact if it holds the true names and no other, or is one of the other right
verdicts that the truth lists. A refused session has no report and is not exact. The first pair of
columns is the diagnosis as it is: no probability changes its verdict. The second pair says what it
would be worth to leave out the names that have less than one half by a fit to the two other
generators."""


def markdown(rows: Sequence[Row], weights: Weights, spread: Spread, facts: Row) -> str:
    """The whole page."""
    parts = [HEAD, _stamp(facts), '## Verdicts', RULES, _verdicts(rows, weights)]
    parts += ['## Reliability, each generator left out of the fit', UNSEEN]
    for generator, found in unseen(rows, weights).items():
        parts += [f'### {generator}', _reliability(found)]
    parts += ['## Weights', WEIGHED, _weights(weights)]
    parts += ['## Intervals', INTERVALS, _spread(spread), _coverage(widened(rows, spread))]
    parts += ['### Each generator left out of the fit', HELD, _held(rows)]
    parts += ['## Structure', STRUCTURE, _structure(rows)]
    return '\n\n'.join(part.strip('\n') for part in parts) + '\n'


def headline(rows: Sequence[Row], weights: Weights, facts: Row) -> str:
    """The block of the blind results: each generator as one that the fit has not seen."""
    lines = []
    for name, stated in unseen(rows, weights).items():
        own = [row for row in rows if row['generator'] == name]
        others = [row for row in rows if row['generator'] != name]
        v, sure = verdicts(own), np.array([s for s in stated if s[0] >= SURE])
        holds = coverage(widened(own, spread_of(others)))['all']['holds']
        cells = [f'{len(sure)}', *(f'{m:.3f}' for m in np.mean(sure, 0)), _number(holds)]
        lines.append([name, f'{v["sessions"]}', f'{v["exact"]:.2f}', f'{v["false"]:.1f}', *cells])
    head = ['left out', 'sessions', 'exact', 'false in 100', f'stated at {SURE:g} and above']
    return f'{_stamp(facts)}\n\n' + table([*head, 'mean stated', 'true', 'interval holds'], lines)


UNSEEN = """The probabilities of each generator come from a fit to the two others."""
WEIGHED = """Weights of the features of each kind of statement, and of the constant (`1`). The
features stand in `evidence/probability.py`. One is taken if it lowers the log-loss on generators
that the fit did not see by at least 5 %."""
HELD = """The estimated deviations hold noise and misfit of the session alone. The factor and the
share that widen them are fitted to the two other generators. Doubts of single parameters
(`Parameter.doubt`) are not: they were set with all generators in view."""
STRUCTURE = """A residual has structure where its share that is no noise is above a threshold
(`SERVO_STRUCTURE` and `TRACKER_STRUCTURE` in `evidence/judgement.py`). The counts show how many
verdicts another threshold could change: at most those between one half of it and twice it."""
INTERVALS = """A deviation is widened by what models of its kind get wrong: by a factor, and
by a share of the value (added in squares) for all but places and phases. Both are the narrowest
that hold 95 % of the truths in sessions with an exact verdict (of a handful of intervals, all).

The second table is of right names, all generators together: how often the stated 95 % interval
holds the truth, its median width over the true value, the median error in standard deviations, and
the share of parameters that are stated without a deviation (not identifiable). Phases and offsets
of a session are not counted, nor parameters whose truth the machines do not state."""


def _stamp(facts: Row) -> str:
    counts = ', '.join(f'{count} of `{name}`' for name, count in facts['sessions'].items())
    return f'Sessions: {counts}.\nSeeds {facts["seeds"]}; code {facts["code"]}; {facts["date"]}.'


def _verdicts(rows: Sequence[Row], weights: Weights) -> str:
    lines = []
    kept = without_doubtful(rows, weights)
    for name in (*GENERATORS, 'all'):
        cells = []
        for found in (rows, kept):
            v = verdicts([r for r in found if name in ('all', r['generator'])])
            cells += [f'{v["exact"]:.2f}', f'{v["false"]:.1f}']
        lines.append([name, f'{v["sessions"]}', f'{v["refused"]}', *cells])
    head = ['generator', 'sessions', 'refused', 'exact', 'false in 100']
    return table([*head, 'without the doubtful: exact', 'false in 100'], lines)


def _reliability(found: list[tuple[float, bool]]) -> str:
    lines = [
        [f'{low:.2f} to {high:.2f}', f'{len(within)}', *(f'{m:.3f}' for m in np.mean(within, 0))]
        for low, high, within in bins(found)
    ]
    return table(['stated', 'number', 'mean stated', 'true'], lines)


def _weights(weights: Weights) -> str:
    lines = [
        [kind, ', '.join(f'{name} {value:+.3g}' for name, value in own.items())]
        for kind, own in weights.items()
    ]
    return table(['statement', 'weights'], lines)


def _coverage(rows: Sequence[Row]) -> str:
    lines = [
        [key, f'{c["count"]:.0f}', *(_number(c[k]) for k in ('holds', 'width', 'bias', 'open'))]
        for key, c in coverage(rows).items()
    ]
    head = ['parameter', 'n', 'holds the truth', 'relative width', 'error / σ', 'not identifiable']
    return table(head, lines)


def _spread(spread: Spread) -> str:
    lines = [[link, f'{f:.2f}', f'{100.0 * share:.2g} %'] for link, (f, share) in spread.items()]
    return table(['models of', 'factor', 'share of the value'], lines)


def _held(rows: Sequence[Row]) -> str:
    lines = []
    for generator in GENERATORS:
        own = [row for row in rows if row['generator'] == generator]
        others = [row for row in rows if row['generator'] != generator]
        cells = []
        for found in (own, widened(own, spread_of(others))):
            c = coverage(found)['all']
            cells += [_number(c['holds']), _number(c['width'])]
        lines.append([generator, f'{coverage(own)["all"]["count"]:.0f}', *cells])
    head = ['generator', 'n', 'estimated: holds', 'relative width', 'widened: holds']
    return table([*head, 'relative width'], lines)


def _structure(rows: Sequence[Row]) -> str:
    lines = []
    for link, threshold in (('servo', SERVO_STRUCTURE), ('tracker', TRACKER_STRUCTURE)):
        lines.append([link, f'{threshold:g}', *map(str, near(rows, link, threshold))])
    head = ['residual', 'threshold', 'below one half of it', 'up to it', 'up to twice it', 'above']
    return table(head, lines)


def _number(value: float) -> str:
    return '–' if value != value else f'{value:.2g}'


def write_weights(path: Path, weights: Weights, spread: Spread, facts: Row) -> None:
    """The module that the diagnosis imports."""
    lines = [
        '"""Weights of the probabilities; `make calibrate-diagnosis` writes them."""',
        '',
        f'CODE = {facts["code"]!r}',
        f'DATE = {facts["date"]!r}',
        'SESSIONS = {',
        *(f'    {name!r}: {count},' for name, count in facts['sessions'].items()),
        '}',
        f'SEEDS = {facts["seeds"]!r}',
        'WEIGHTS: dict[str, dict[str, float]] = {',
    ]
    for kind, own in weights.items():
        lines += [f'    {kind!r}: {{']
        lines += [f'        {name!r}: {value:.6g},' for name, value in own.items()]
        lines += ['    },']
    lines += ['}', 'SPREAD: dict[str, tuple[float, float]] = {']
    lines += [f'    {link!r}: ({f:.4g}, {share:.4g}),' for link, (f, share) in spread.items()]
    path.write_text('\n'.join([*lines, '}']) + '\n', encoding='utf-8')
