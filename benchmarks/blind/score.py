"""Scorer: opens the sealed truth once and compares it with the reports."""

from __future__ import annotations

import hashlib
import json
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.generators.score import bins

Row = dict[str, Any]

#: Edges of the bins of stated probability.
BINS = (0.0, 0.05, 0.2, 0.5, 0.8, 0.95, 1.0)


def score(directory: Path) -> dict[str, Any]:
    """Scores of each suite in a directory, with 95 % bootstrap intervals, and all cases."""
    sealed = (directory / 'truth.sealed.json').read_text(encoding='utf-8')
    digest = hashlib.sha256(sealed.encode()).hexdigest()
    if digest != (directory / 'truth.sha256').read_text(encoding='utf-8').strip():
        raise SystemExit('the sealed truth is not the one whose hash was published')
    rows = [
        _row(case, directory / f'{case["suite"]}_{case["number"]:04d}')
        for case in json.loads(sealed)
    ]
    suites = list(dict.fromkeys(r['suite'] for r in rows))
    return {
        'sha256': digest,
        'suites': {s: suite_scores([r for r in rows if r['suite'] == s]) for s in suites},
        'cases': rows,
    }


def suite_scores(rows: list[Row]) -> dict[str, Any]:
    """Scores of the cases of one suite."""
    # A sealed truth without a named effect: nothing at all, or only what is outside the library.
    empty = [r for r in rows if not r['named']]
    return {
        'cases': len(rows),
        'exact': interval([r['exact'] for r in rows]),
        'top1': interval([r['top1'] for r in rows if r['expected']]),
        'probability_of_true': interval(
            [p for r in rows if r['expected'] for p in r['probability_of_true']]
        ),
        'false_naming': interval([bool(r['false']) for r in empty]),
        'false_naming_anywhere': interval([bool(r['false']) for r in rows]),
        'unknown_said': interval(
            ['unknown' in r['verdict'] for r in rows if 'unknown' in r['expected']]
        ),
        'shrink_difference_points': interval(
            [r['difference'] for r in rows if r['difference'] is not None]
        ),
        'seconds': interval([r['seconds'] for r in rows if r['seconds'] is not None]),
        'exact_by_kind': {
            kind: interval([r['exact'] for r in rows if r['kind'] == kind])
            for kind in sorted({r['kind'] for r in rows})
        },
        'calibration': calibration(rows),
        'confusion': confusion(rows),
        'baselines': baseline_scores(rows),
    }


def _row(case: dict[str, Any], folder: Path) -> Row:
    expected = list(case['expected'])
    report = _read(folder / 'out' / 'report.json')
    fresh = _read(folder / 'fresh' / 'report.json')
    verdict = report['verdict'] if report else ['error']
    probability = {c['effect']: c['probability'] for c in report['causes']} if report else {}
    candidates = {n: p for n, p in probability.items() if n != 'none'}
    top = max(candidates, key=lambda n: candidates[n]) if candidates else ''
    difference = None
    if report and fresh:
        difference = 100.0 * abs(report['gap']['shrink'] - fresh['gap']['shrink'])
    return {
        'suite': case['suite'],
        'number': case['number'],
        'kind': case['kind'],
        'axes': case['axes'],
        'rate': case['rate'],
        'planted': case['planted'],
        'without': case['without'],
        'expected': expected,
        'named': [e for e in expected if e != 'unknown'],
        'verdict': verdict,
        'exact': set(verdict) == set(expected),
        'top1': top in expected,
        'false': [v for v in verdict if v not in (*expected, 'unknown')],
        'probability_of_true': [probability.get(e, 0.0) for e in expected],
        'probability': probability,
        'shrink': report['gap']['shrink'] if report else None,
        'difference': difference,
        'seconds': _read(folder / 'done.json').get('seconds', {}).get('out'),
        'baselines': _read(folder / 'baselines.json'),
    }


def _read(path: Path) -> dict[str, Any]:
    """Content of a JSON file; empty where there is none."""
    return json.loads(path.read_text(encoding='utf-8')) if path.exists() else {}


def interval(values: list[Any]) -> dict[str, float | int]:
    """Mean with its 95 % bootstrap interval over cases.

    Shares of 0 or 1, whose bootstrap has no width, get the exact bound (Clopper and Pearson).
    """
    if not values:
        return {'count': 0}
    numbers = np.asarray(values, dtype=float)
    generator = np.random.default_rng(0)
    means = numbers[generator.integers(0, len(numbers), (2000, len(numbers)))].mean(axis=1)
    low, high = (float(v) for v in np.percentile(means, [2.5, 97.5]))
    if all(isinstance(v, (bool, np.bool_)) for v in values) and low == high:
        bound = 0.025 ** (1.0 / len(numbers))
        low, high = (bound, 1.0) if low == 1.0 else (0.0, 1.0 - bound)
    return {'mean': float(numbers.mean()), 'low': low, 'high': high, 'count': len(numbers)}


def calibration(rows: list[Row]) -> list[dict[str, Any]]:
    """Stated probabilities beside how often they were true."""
    pairs = [
        (p, name in r['expected'] or (name == 'none' and not r['expected']))
        for r in rows
        for name, p in r['probability'].items()
    ]
    return [
        {
            'from': low,
            'to': high,
            'stated': float(np.mean([p for p, _ in within])),
            'true': interval([t for _, t in within]),
            'count': len(within),
        }
        for low, high, within in bins(pairs, BINS)
    ]


def confusion(rows: list[Row]) -> dict[str, dict[str, int]]:
    """What was named where one effect, or nothing, was at work."""
    table: dict[str, Counter[str]] = {}
    for r in rows:
        if len(r['expected']) > 1:
            continue
        truth = r['expected'][0].partition('.')[0] if r['expected'] else 'none'
        named = [v.partition('.')[0] for v in r['verdict']] or ['none']
        table.setdefault(truth, Counter()).update(named)
    return {truth: dict(counts) for truth, counts in sorted(table.items())}


def baseline_scores(rows: list[Row]) -> dict[str, dict[str, Any]]:
    """Exact sets, true effects among those named, and false namings of each baseline."""
    out = {}
    for name in rows[0]['baselines'] if rows else {}:
        answered = [(r, r['baselines'].get(name, [])) for r in rows]
        out[name] = {
            'exact': interval([set(a) == set(r['expected']) for r, a in answered]),
            'top1': interval(
                [len(a) == 1 and a[0] in r['expected'] for r, a in answered if r['expected']]
            ),
            'false_naming': interval(
                [
                    any(v not in (*r['expected'], 'unknown') for v in a)
                    for r, a in answered
                    if not r['named']
                ]
            ),
        }
    return out
