"""Diagnoses every case of a folder by a command, and scores the reports against the truth."""

from __future__ import annotations

import itertools
import json
import shlex
import subprocess
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.calibrate.truth import in_report_terms
from benchmarks.generators import worth
from stage_core.metrics import SIGMAS
from stage_core.twin_file import TwinFile

# These belong to the whole session; a report that adds an axis means the same.
SESSION_WIDE = ('sample_jitter',)
BINS = (0.0, 0.05, 0.2, 0.5, 0.8, 0.9, 0.99, 1.0)
#: Effects that are curves, with their parameters that are no coefficients of these.
CURVES = {
    'position_force': (), 'position_dependent_friction': ('presliding',),
    'straightness': (), 'angular_error': ('arm',),
}  # fmt: skip
DIGITS = 1e-6
Row = dict[str, Any]


def score(folders: Sequence[Path], command: str, jobs: int, again: bool) -> int:
    """Prints a line a case and the summary; returns 1 where there are no cases."""
    cases = [path.parent for folder in folders for path in sorted(folder.glob('*/truth.json'))]
    if not cases:
        print(f'error: no case (truth.json) under {", ".join(map(str, folders))}; make some first')
        return 1
    with ThreadPoolExecutor(jobs) as pool:
        rows = []
        for row in pool.map(lambda case: _scored(case, command, again), cases):
            print(_line(row), flush=True)
            rows.append(row)
    print('\n'.join(summary(rows)))
    return 0


def _scored(case: Path, command: str, again: bool) -> Row:
    report = case / 'report' / 'report.json'
    error = ''
    if again or not report.exists():
        words = [*shlex.split(command), '--bag', str(case / 'bag')]
        done = subprocess.run(
            [*words, '--twin', str(case / 'twin.yaml'), '--out', str(case / 'report')],
            capture_output=True,
            text=True,
            check=False,
        )
        lines = (done.stderr + done.stdout).strip().splitlines() or ['']
        error = f'exit {done.returncode}: {lines[-1]}' if done.returncode else ''
    truth = read_truth(json.loads((case / 'truth.json').read_text()))
    truth = in_report_terms(truth, TwinFile.load(case / 'twin.yaml'))
    found = None if error or not report.exists() else json.loads(report.read_text())
    row = judged(case.name, truth, found, error)
    known = set(truth['truth']).union(*truth['also_right'])
    return row | {'statements': list(worth.statements(found, known)) if found else []}


def read_truth(truth: Row) -> Row:
    """A truth, also one of another simulator: `names`, `effects` with `params`, `instead`."""
    if 'truth' in truth:
        return truth
    planted = [{'name': e['name'], 'parameters': e['params']} for e in truth['effects']]
    names = truth['names']
    kind = 'unknown' if 'unknown' in names else f'{len(names)} effects'
    return {'truth': names, 'also_right': truth['instead'], 'planted': planted, 'kind': kind}


def judged(name: str, truth: Row, report: Row | None, error: str = '') -> Row:
    """What the scorer keeps of one case.

    Exact is a verdict that is `truth` or one of `also_right`; a false name is in none of these;
    top-1 means that the first cause named (or `none`) is right.
    """
    wanted = set(truth['truth'])
    right = [wanted, *map(set, truth['also_right'])]
    row: Row = {'name': name, 'kind': truth['kind'], 'truth': sorted(wanted), 'error': error}
    if report is None:
        return row | {'verdict': None, 'exact': False, 'top': False, 'false': []}
    verdict = [_plain(effect) for effect in report['verdict']]
    known = set().union(*right)
    return row | {
        'verdict': verdict,
        'exact': set(verdict) in right,
        'top': verdict[0] in known if verdict else set() in right,
        'false': [effect for effect in verdict if effect not in known],
        'stated': [
            (float(cause['probability']), _is_true(_plain(cause['effect']), wanted, known))
            for cause in report['causes']
        ],
        'intervals': list(_intervals(truth, report)),
    }


def _plain(effect: str) -> str:
    base = effect.split('.')[0]
    return base if base in SESSION_WIDE else effect


def _is_true(effect: str, wanted: set[str], known: set[str]) -> bool:
    return not wanted if effect == 'none' else effect in known


def _intervals(truth: Row, report: Row) -> Any:
    """Effect, parameter, error over standard deviation, relative width: where names match.

    Of curves nothing but what is no coefficient: each simulator lays its own otherwise.
    """
    planted = {p['name']: p['parameters'] for p in truth['planted']}
    for cause in report['causes']:
        name = _plain(cause['effect'])
        if cause['status'] != 'accepted' or name not in planted or name not in truth['truth']:
            continue
        for parameter, found in cause['parameters'].items():
            true = planted[name].get(parameter)
            std = found.get('std')
            known = isinstance(true, float | int) and found.get('value') is not None
            if not known or not std or not np.isfinite(std) or _of_curve(name, parameter):
                continue
            if parameter.startswith('period') and true == 0.0:  # the lead
                continue
            error = found['value'] - true
            if 'phase' in parameter:
                error = (error + np.pi) % (2.0 * np.pi) - np.pi
            # A report has so many digits.
            sigmas = error / std if abs(error) > DIGITS * abs(true) else 0.0
            yield name, parameter, sigmas, 3.92 * std / max(abs(true), 1e-12)


def _of_curve(name: str, parameter: str) -> bool:
    return parameter not in CURVES.get(name.split('.')[0], (parameter,))


def _line(row: Row) -> str:
    mark = 'exact' if row['exact'] else 'top  ' if row['top'] else '     '
    verdict = row['error'] if row['verdict'] is None else ', '.join(row['verdict']) or 'nothing'
    return f'{mark}  {row["name"]:50s}  {verdict}'


def summary(rows: list[Row]) -> list[str]:
    """Lines: shares over all and per kind, false names, intervals, reliability."""
    lines = ['', f'{"kind":10s} {"cases":>5s} {"exact":>6s} {"top-1":>6s} {"false":>6s}']
    for kind in ['all', *sorted({row['kind'] for row in rows})]:
        of_kind = [row for row in rows if kind in ('all', row['kind'])]
        n = len(of_kind)
        exact, top = (sum(row[key] for row in of_kind) / n for key in ('exact', 'top'))
        false = sum(len(row['false']) for row in of_kind)
        lines.append(f'{kind:10s} {n:5d} {exact:6.2f} {top:6.2f} {false:6d}')
    false = sum(len(row['false']) for row in rows)
    unknown = [row for row in rows if row['kind'] == 'unknown' and row['verdict'] is not None]
    handled = sum('unknown' in row['verdict'] for row in unknown)
    refused = sum(row['verdict'] is None for row in rows)
    lines.append(f'false names in 100 sessions: {100.0 * false / len(rows):.1f}')
    lines.append(f'unknown named where it is the truth: {handled} of {len(unknown)}')
    lines.append(f'no report: {refused}')
    said = [statement for row in rows for statement in row.get('statements', [])]
    return lines + _coverage(rows) + _reliability(rows) + worth.lines(said)


def _coverage(rows: list[Row]) -> list[str]:
    found: dict[str, list[tuple[float, float]]] = {}
    for row in rows:
        for name, parameter, sigmas, width in row.get('intervals', []):
            effect = name.split('.')[0]
            for key in (effect, f'{effect}.{parameter}'):
                found.setdefault(key, []).append((sigmas, width))
    everything = [entry for key, entries in found.items() if '.' not in key for entry in entries]
    lines = ['', f'{"95 % intervals":45s} {"n":>4s} {"hold":>5s} {"relative width":>15s}']
    for key, entries in [*sorted(found.items()), ('all', everything)]:
        if not entries:
            continue
        held = float(np.mean([abs(sigmas) <= SIGMAS for sigmas, _ in entries]))
        width = float(np.median([width for _, width in entries]))
        lines.append(f'{key:45s} {len(entries):4d} {held:5.2f} {width:15.3g}')
    return lines


def bins(
    stated: Sequence[tuple[float, bool]], edges: Sequence[float] = BINS
) -> list[tuple[float, float, list[tuple[float, bool]]]]:
    """Per bin that is not empty: its edges, and the probabilities stated in it with their truth.

    A bin holds its lower edge, the last one both.
    """
    last = edges[-1]
    return [
        (low, high, within)
        for low, high in itertools.pairwise(edges)
        if (within := [s for s in stated if low <= s[0] < high or s[0] == high == last])
    ]


def _reliability(rows: list[Row]) -> list[str]:
    stated = [pair for row in rows for pair in row.get('stated', [])]
    lines = ['', f'{"probability stated":20s} {"n":>5s} {"mean":>6s} {"true":>6s}']
    for low, high, within in bins(stated):
        mean, true = np.mean(within, axis=0)
        lines.append(f'{low:5.2f} to {high:5.2f}       {len(within):5d} {mean:6.3f} {true:6.3f}')
    return lines
