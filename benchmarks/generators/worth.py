"""What kinds of statements of the reports were worth: how many were said, and were true."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

#: From which probability on a name counts as sure, and gaps over the noise from which on the
#: statement that nothing was found is of use.
SURE, FAR = 0.9, 2.0

SURE_NAME = f'a name at {SURE:g} and above, no `unknown` beside it'
BESIDE = 'a name, beside an `unknown`'
OTHERS = 'an effect with alternatives'
UNKNOWN = '`unknown`'
NOTHING = f'no cause, beside a gap of more than {FAR:g} floors'
KINDS = (SURE_NAME, BESIDE, OTHERS, UNKNOWN, NOTHING)


def statements(report: dict[str, Any], known: set[str]) -> Iterator[tuple[str, bool]]:
    """Kind of each statement of a report, and whether it is true; `known` are the true names."""
    for cause in report['causes']:
        if cause['status'] == 'accepted' and (kind := _kind(cause, report)):
            names = {cause['effect'], cause['effect'].split('.')[0]}  # of one axis, or of all
            yield kind, not names.isdisjoint(known)
    gap = report['gap']
    if not report['verdict'] and gap['before'] > FAR * gap['noise_floor']:
        yield NOTHING, not known


def _kind(cause: dict[str, Any], report: dict[str, Any]) -> str | None:
    """Kind of an accepted cause, if it has one."""
    if cause['effect'] == 'none':
        return None
    if cause['effect'] == 'unknown':
        return UNKNOWN
    if 'unknown' in report['verdict']:
        return BESIDE
    if cause['alternatives']:
        return OTHERS
    return SURE_NAME if cause['probability'] >= SURE else None


def lines(said: Sequence[tuple[str, bool]]) -> list[str]:
    """A line per kind: how often it was said, and which share was true."""
    out = ['', f'{"statement":50s} {"said":>5s} {"true":>5s} {"share":>6s}']
    for kind in KINDS:
        true = [is_true for own, is_true in said if own == kind]
        share = f'{sum(true) / len(true):6.3f}' if true else ''
        out.append(f'{kind:50s} {len(true):5d} {sum(true):5d} {share:>6s}'.rstrip())
    return out
