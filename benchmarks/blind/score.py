"""Scorer: opens the sealed truth once and compares it with the reports."""

from __future__ import annotations

import hashlib
import json
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np


def score(directory: Path) -> dict[str, Any]:
    """Scores of all cases in a directory, with 95 % bootstrap intervals."""
    sealed = (directory / 'truth.sealed.json').read_text(encoding='utf-8')
    digest = hashlib.sha256(sealed.encode()).hexdigest()
    if digest != (directory / 'truth.sha256').read_text(encoding='utf-8').strip():
        raise SystemExit('the sealed truth is not the one whose hash was published')
    rows = []
    for case in json.loads(sealed):
        folder = directory / f'case_{case["number"]:04d}'
        path = folder / 'out' / 'report.json'
        report = json.loads(path.read_text()) if path.exists() else None
        rows.append(_row(case, report, folder))
    causes = [r for r in rows if r['expected']]
    empty = [r for r in rows if not r['named']]
    return {
        'cases': len(rows),
        'exact': _interval([r['exact'] for r in rows]),
        'top1': _interval([r['top1'] for r in causes]),
        'probability_of_true': _interval([p for r in causes for p in r['probabilities']]),
        'false_naming': _interval([r['false'] for r in empty]),
        'shrink_difference_points': _interval(
            [r['difference'] for r in rows if r['difference'] is not None]
        ),
        'exact_by_kind': {
            kind: _interval([r['exact'] for r in rows if r['kind'] == kind])
            for kind in sorted({r['kind'] for r in rows})
        },
        'calibration': _calibration(rows),
        'confusion': _confusion(rows),
        'baselines': _baselines(rows),
        'failures': [
            {k: r[k] for k in ('number', 'kind', 'expected', 'verdict')}
            for r in rows
            if not r['exact']
        ],
        'sha256': digest,
    }


def _row(case: dict[str, Any], report: dict[str, Any] | None, folder: Path) -> dict[str, Any]:
    expected = list(case['expected'])
    verdict = report['verdict'] if report else ['error']
    probability = {c['effect']: c['probability'] for c in report['causes']} if report else {}
    ambiguous = {
        c['effect']: set(c['alternatives'])
        for c in (report['causes'] if report else [])
        if c['status'] == 'accepted'
    }
    named = [e for e in expected if e != 'unknown']
    candidates = {n: p for n, p in probability.items() if n != 'none'}
    top = max(candidates, key=lambda n: candidates[n]) if candidates else ''
    fresh = folder / 'fresh' / 'report.json'
    difference = None
    if report and fresh.exists():
        achieved = json.loads(fresh.read_text())['gap']['shrink']
        difference = 100.0 * abs(report['gap']['shrink'] - achieved)
    return {
        'number': case['number'],
        'kind': case['kind'],
        'expected': expected,
        'named': named,
        'verdict': verdict,
        'exact': set(verdict) == set(expected),
        'top1': top in expected,
        'false': any(v not in (*expected, 'unknown') for v in verdict),
        'within_ambiguity': all(
            e in verdict or any(e in a for a in ambiguous.values()) for e in expected
        ),
        'probabilities': [probability.get(e, 0.0) for e in expected],
        'all_probabilities': probability,
        'difference': difference,
    }


def _interval(values: list[Any]) -> dict[str, float | int]:
    if not values:
        return {'count': 0}
    numbers = np.asarray(values, dtype=float)
    generator = np.random.default_rng(0)
    means = numbers[generator.integers(0, len(numbers), (2000, len(numbers)))].mean(axis=1)
    low, high = np.percentile(means, [2.5, 97.5])
    return {
        'mean': float(numbers.mean()),
        'low': float(low),
        'high': float(high),
        'count': len(numbers),
    }


def _calibration(rows: list[dict[str, Any]]) -> list[dict[str, float]]:
    pairs = [
        (p, name in r['expected'] or (name == 'none' and not r['expected']))
        for r in rows
        for name, p in r['all_probabilities'].items()
    ]
    out = []
    for low, high in ((0.0, 0.05), (0.05, 0.2), (0.2, 0.5), (0.5, 0.8), (0.8, 0.95), (0.95, 1.01)):
        inside = [(p, t) for p, t in pairs if low <= p < high]
        if inside:
            out.append(
                {
                    'from': low,
                    'to': min(high, 1.0),
                    'stated': float(np.mean([p for p, _ in inside])),
                    'true': float(np.mean([t for _, t in inside])),
                    'count': len(inside),
                }
            )
    return out


def _confusion(rows: list[dict[str, Any]]) -> dict[str, dict[str, int]]:
    """What was named where something else, or nothing, was at work (single causes)."""
    table: dict[str, Counter[str]] = {}
    for r in rows:
        if len(r['expected']) > 1:
            continue
        truth = r['expected'][0].partition('.')[0] if r['expected'] else 'none'
        named = [v.partition('.')[0] for v in r['verdict']] or ['none']
        table.setdefault(truth, Counter()).update(named)
    return {truth: dict(counts) for truth, counts in sorted(table.items())}


def _baselines(rows: list[dict[str, Any]]) -> dict[str, float]:
    """Exact sets that answers without thought would get."""
    frequent = Counter(tuple(r['expected']) for r in rows).most_common(1)[0][0]
    return {
        'always unknown': float(np.mean([r['expected'] == ['unknown'] for r in rows])),
        'always none': float(np.mean([not r['expected'] for r in rows])),
        'most frequent answer': float(np.mean([tuple(r['expected']) == frequent for r in rows])),
    }


def text(result: dict[str, Any]) -> str:
    """The scores as lines for a terminal."""
    lines = [f'{result["cases"]} cases']
    for name in (
        'exact',
        'top1',
        'probability_of_true',
        'false_naming',
        'shrink_difference_points',
    ):
        value = result[name]
        if value['count']:
            lines.append(
                f'{name:26s} {value["mean"]:.3f} [{value["low"]:.3f}, {value["high"]:.3f}] '
                f'n={value["count"]}'
            )
    for kind, value in result['exact_by_kind'].items():
        lines.append(f'  exact, {kind:10s} {value["mean"]:.3f} n={value["count"]}')
    for bin_ in result['calibration']:
        lines.append(f'  stated {bin_["stated"]:.3f} true {bin_["true"]:.3f} n={bin_["count"]}')
    lines += [f'  baseline {k}: {v:.3f}' for k, v in result['baselines'].items()]
    lines += [
        f'  missed {f["number"]} ({f["kind"]}): {f["expected"]} -> {f["verdict"]}'
        for f in result['failures']
    ]
    return '\n'.join(lines)
