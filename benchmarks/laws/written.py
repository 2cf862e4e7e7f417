"""The results of the blind check of the law as a page."""

from __future__ import annotations

import json
import textwrap
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from benchmarks.rows import commit

PARTS = {
    'effects': 'effects',
    'none': 'sessions without structure',
    'planted': 'planted laws',
}
GOAL = 0.8  # share of what the named effect closes


def page(folder: Path, wanted: Mapping[str, int], no_function: Sequence[str], command: str) -> str:
    """Markdown of docs/results/law.md from the rows in a folder, of so many that are wanted."""
    rows = {part: _rows(folder, part) for part in ('effects', 'none', 'planted')}
    return '\n'.join(
        [
            '# Results: the law of the remainder',
            '',
            f'    {command}',
            '',
            f'Commit {commit()}, {time.strftime("%Y-%m-%d")}. Sessions of 20 s, both axes, '
            'tracker at 100 Hz with 1 µm noise.',
            '[The law of the remainder](../concepts/law.md) says how the law is found.',
            '',
            *_made(rows, wanted),
            *_effects(rows['effects'], no_function),
            *_none(rows['none']),
            *_planted(rows['planted']),
        ]
    )


def _made(rows: Mapping[str, Sequence[dict[str, Any]]], wanted: Mapping[str, int]) -> list[str]:
    """Which code made the rows, and how many are not made yet."""
    codes = sorted({row['code'] for part in rows.values() for row in part})
    lines = textwrap.wrap(
        f'Code of commit {", ".join(codes)}. The goals: 0.8 for every effect, at most 2 laws in '
        '100 sessions without structure, every planted law.',
        99,
    )
    if any(len(rows[part]) < count for part, count in wanted.items()):
        made = ', '.join(
            f'{len(rows[part])} of {count} {PARTS[part]}' for part, count in wanted.items()
        )
        lines += ['The run is not complete. It holds', f'{made}.']
    return [*lines, '']


def _rows(folder: Path, part: str) -> list[dict[str, Any]]:
    return [json.loads(p.read_text(encoding='utf-8')) for p in sorted(folder.glob(f'{part}_*'))]


def _effects(rows: Sequence[dict[str, Any]], no_function: Sequence[str]) -> list[str]:
    good = [r for r in rows if r['laws'] and (r['counts'] or 0.0) >= GOAL]
    lines = [
        '## Effects taken out of the library',
        '',
        'Each effect is taken out with its relatives (`--without`). `closed` is what the rest of '
        'the',
        'library and the law close of the held-out gap, over what the effect itself closes where '
        'it is',
        f'the whole library. At least {GOAL:g} with a law: {len(good)} of {len(rows)}.',
        '',
        'Where effects of the rest close the gap so well that nothing remains, there is no '
        'remainder to',
        'have a law of. They are then taken out, too, and stand under `also out`.',
        '',
        '| effect | closed | also out | verdict without them | law |',
        '|---|---|---|---|---|',
    ]
    for row in rows:
        closed = '–' if row['counts'] is None else f'{row["counts"]:.2f}'
        names = ', '.join(f'`{name}`' for name in row['without']) or 'none'
        laws = '; '.join(
            f'{law["channel"]} = `{law["expression"]}` '
            f'({law["kind"]}{_instead(law)}, {100 * law["shrink"]:.0f} %)'
            for law in row['laws']
        )
        out = ', '.join(f'`{name}`' for name in row['standing_in']) or '–'
        lines.append(f'| `{row["effect"]}` | {closed} | {out} | {names} | {laws or "none"} |')
    names = ', '.join(f'`{name}`' for name in no_function)
    return [
        *lines,
        '',
        *textwrap.wrap(
            'No functions of the basis, and therefore `unknown` when they are taken out: '
            f'{names}.',
            99,
            break_on_hyphens=False,
        ),
        '',
    ]


def _instead(law: Mapping[str, Any]) -> str:
    names = ', '.join(f'`{name}`' for name in law['instead'])
    return f' in the place of {names}' if names else ''


def _none(rows: Sequence[dict[str, Any]]) -> list[str]:
    wrong = [r for r in rows if r['laws']]
    return [
        '## Sessions without structure',
        '',
        f'The search alone, without the gate that structure remains: {len(wrong)} of {len(rows)} '
        'sessions of the',
        'nominal machine get a law of any of their four residuals.',
        '',
    ]


def _planted(rows: Sequence[dict[str, Any]]) -> list[str]:
    good = [r for r in rows if r['recovered']]
    whole = [r for r in good if not r['standing_in']]
    lines = [
        '## Planted laws',
        '',
        'An exponent counts as recovered within 0.15, a period within 1 %. '
        f'Recovered: {len(good)} of {len(rows)},',
        f'{len(whole)} of them with the whole library at hand. In the others effects of it closed '
        'the gap so well',
        'that nothing remained: the names are wrong. `also out` are those that then had to go.',
        '',
        '| law | seed | planted | found | also out | verdict | expression | closes |',
        '|---|---|---|---|---|---|---|---|',
    ]
    for row in rows:
        found = '–' if row['found'] != row['found'] else f'{row["found"]:.4g}'
        names = ', '.join(f'`{name}`' for name in row['verdict']) or 'none'
        out = ', '.join(f'`{name}`' for name in row['standing_in']) or '–'
        words = row['words'].replace('|', '\\|')
        lines.append(
            f'| {words} | {row["seed"]} | {row["number"]:.4g} | {found} | {out} | {names} | '
            f'`{row["expression"] or "none"}` | {100 * row["shrink"]:.0f} % |'
        )
    return [*lines, '']
