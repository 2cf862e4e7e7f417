"""Figures of the calibration: reliability, exact sets and false names, coverage of intervals."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from benchmarks.calibrate.fit import CANDIDATES, left_out, statements
from benchmarks.calibrate.truth import belongs_to_machine
from benchmarks.generators.score import judged
from gap_diagnosis.evidence.describe import is_magnitude
from stage_core.metrics import SIGMAS
from stage_core.quantities import split_effect

Row = dict[str, Any]
Pairs = list[tuple[float, bool]]

#: Widths from here on are relative to a truth of 0.
NO_SHARE = 1e3


def verdicts(rows: Sequence[Row]) -> dict[str, float]:
    """Share of exact sets, false names in 100 sessions, share without a report."""
    n = max(len(rows), 1)
    return {
        'sessions': len(rows),
        'exact': sum(row['exact'] for row in rows) / n,
        'false': 100.0 * sum(len(row['false']) for row in rows) / n,
        'refused': sum(row['verdict'] is None for row in rows),
    }


def near(rows: Sequence[Row], link: str, threshold: float) -> list[int]:
    """Residuals of a link by their share that is structure, over the threshold.

    Counts below one half of it, up to it, up to twice it, and above.
    """
    shares = [s for row in rows for name, s, _ in row['structure'] if name.startswith(link)]
    return np.histogram(np.array(shares) / threshold, (-np.inf, 0.5, 1.0, 2.0, np.inf))[0].tolist()


def unseen(rows: Sequence[Row], weights: dict[str, dict[str, float]]) -> dict[str, Pairs]:
    """Per generator: probability of each statement by a fit to the other generators, and truth.

    `weights` name the features of each kind.
    """
    by_session: dict[tuple[str, str], list[list[Any]]] = {}
    for kind in CANDIDATES:
        for s, probability in _unseen(rows, kind, weights[kind]):
            at = by_session.setdefault((s['generator'], s['session']), [])
            at.append([probability, bool(s['true']), kind])
    out: dict[str, Pairs] = {}
    for (generator, _), one in by_session.items():
        out.setdefault(generator, []).extend(_dealt_out(one))
    return out


def _unseen(rows: Sequence[Row], kind: str, weights: dict[str, float]) -> list[tuple[Row, float]]:
    found = statements(rows, kind)
    return list(zip(found, left_out(found, [n for n in weights if n != '1']), strict=True))


def without_doubtful(rows: Sequence[Row], weights: dict[str, dict[str, float]]) -> list[Row]:
    """The sessions judged without names that have less than 1/2 by a fit to the others."""
    doubtful = {
        (s['generator'], s['session'], s['effect'])
        for s, probability in _unseen(rows, 'named', weights['named'])
        if probability < 0.5
    }
    return [_judged_again(row, doubtful) for row in rows]


def _judged_again(row: Row, doubtful: set[tuple[str, str, str]]) -> Row:
    if row['verdict'] is None:
        return row
    kept = [n for n in row['verdict'] if (row['generator'], row['name'], n) not in doubtful]
    truth = {'planted': [], **{k: row[k] for k in ('kind', 'truth', 'also_right')}}
    return row | judged(row['name'], truth, {'verdict': kept, 'causes': []})


def _dealt_out(one: list[list[Any]]) -> Pairs:
    """As `with_probabilities` does: where one thing is said the others share what it leaves."""
    said = [s for s in one if s[2] != 'passed']
    if len(said) == 1:
        rest = sum(s[0] for s in one if s[2] == 'passed')
        factor = (1.0 - said[0][0]) / rest
        one = [[s[0] * (factor if s[2] == 'passed' else 1.0), *s[1:]] for s in one]
    return [(s[0], s[1]) for s in one]


def coverage(rows: Sequence[Row]) -> dict[str, dict[str, float]]:
    """Per parameter: number, share that holds the truth, median width, median error in sigmas."""
    found: dict[str, list[tuple[float, float]]] = {}
    for row in rows:
        for name, parameter, sigmas, width in row.get('intervals', []):
            if belongs_to_machine(name, parameter):
                key = f'{split_effect(name)[0]}.{parameter}'
                found.setdefault(key, []).append((sigmas, width))
                found.setdefault('all', []).append((sigmas, width))
    open_ = unidentified(rows)
    out = {}
    for key in sorted({*found, *open_}, key=lambda k: (k == 'all', k)):
        values = np.array(found.get(key, [])).reshape(-1, 2)
        known = len(values)
        named = known + open_.get(key, 0)
        out[key] = {
            'count': known,
            'holds': float(np.mean(np.abs(values[:, 0]) <= SIGMAS)) if known else np.nan,
            'width': _median(values[:, 1]),
            'bias': _median(values[:, 0]),
            'open': open_.get(key, 0) / named if named else np.nan,
        }
    return out


def _median(values: np.ndarray) -> float:
    """Median of what is finite and not relative to a truth of 0."""
    counted = values[np.abs(values) < NO_SHARE]
    return float(np.median(counted)) if len(counted) else np.nan


def unidentified(rows: Sequence[Row]) -> dict[str, int]:
    """How often a physical parameter of a right name has no finite standard deviation."""
    found: dict[str, int] = {}
    for row in rows:
        for s in row['statements']:
            for parameter, (_, std) in s['parameters'].items() if s['true'] else ():
                if not is_magnitude(s['effect'], parameter):
                    continue
                if not (np.isfinite(std) and std > 0.0):
                    key = f'{split_effect(s["effect"])[0]}.{parameter}'
                    for name in (key, 'all'):
                        found[name] = found.get(name, 0) + 1
    return found
