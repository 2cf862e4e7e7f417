"""The gap diagnosis on records of machines that others built, beside their authors' word.

    python -m benchmarks.real_records --out build/real_records [--only emps odrive_nocomp]

Each row is kept as a file in the folder. The page docs/results/real_records.md is written from
the rows that are there. The data are read from `STAGE_DATA` (or ../shared/data); bags.md has
their sources.
"""

from __future__ import annotations

import argparse
import functools
import json
import sys
import textwrap
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.rows import kept
from gap_diagnosis.closed_loop.replay import replay
from gap_diagnosis.diagnose import diagnose
from gap_diagnosis.report.causes import parameter_words
from gap_diagnosis.result import Diagnosis
from session_bags import (
    convert_emps,
    convert_ess_tank,
    convert_odrive_cogging,
    convert_xy_circle,
)
from session_bags.measured import data_folder
from stage_core.errors import command_line
from stage_core.session import Session
from stage_core.twin_file import TwinFile
from stage_twin.effects.waveform import HARMONICS

#: What the figures of a row do not say by themselves.
REMARKS = {
    'emps': 'The pulses are a declared input, the controller is that of the file. Its velocity '
    'has a filter that the files do not state, which is the mismatch of the controller. The '
    'friction near standstill that a ladder of models adds last (Stribeck; 2.10 µm and 2.91 N '
    'over the whole of the test file) is not named. The files begin 0.1 mm away from their '
    'reference, a twin begins on it.',
    'ess_stops': 'The play differs from place to place, so that `unknown` stands beside it.',
    'odrive_nocomp': 'One direction but for two fast returns: whether the constant is an offset '
    'or friction is less certain than its probability says.',
    'odrive_comp': 'The current has to hold against the cogging with the map too, so that its '
    'ripple stays. What the map takes away is how far the position strays.',
}
PAGE = Path(__file__).resolve().parents[1] / 'docs' / 'results' / 'real_records.md'


@dataclass(frozen=True)
class Row:
    """One diagnosis: a converter, the sessions that fit, those held out, and the authors' word."""

    sessions: Callable[[Path], Mapping[str, Session]]
    fit: tuple[str, ...]
    held_out: tuple[str, ...]
    unit: str  # of a position
    effort: str
    word: str


CIRCLE = 'no cause is published; the axes differ, and a tool touches the stage'
COGGING = 'cogging; harmonics 7, 14, 28, 12, 36 and 84 of a turn'
ROWS = {
    'emps': Row(
        convert_emps.sessions, ('emps',), ('emps_pulses',), 'µm', 'N',
        'asymmetric friction: Coulomb 20.14 and 20.63 N, viscous 166.7 and 240.4 N·s/m',
    ),
    'ess_stroke': Row(
        convert_ess_tank.sessions, ('ess_tank_stroke',), (), 'µrad', '',
        'a cyclic error with a period of 5 to 6° (0.087 to 0.105 rad), and backlash, which a '
        'stroke in one direction cannot show',
    ),
    'ess_stops': Row(
        convert_ess_tank.sessions, ('ess_tank_stops',), (), 'µrad', '',
        'backlash, and a cyclic error, whose period the stops (10° apart) cannot show',
    ),
    'odrive_nocomp': Row(
        convert_odrive_cogging.sessions, ('slow2_nocomp_0', 'slow2_nocomp_1'),
        ('slow2_nocomp_2',), 'rad', 'A', COGGING,
    ),
    'odrive_comp': Row(
        convert_odrive_cogging.sessions, ('slow2_comp_0', 'slow2_comp_1'), ('slow2_comp_2',),
        'rad', 'A', f'the same motor, its current corrected by a map of the cogging: {COGGING}',
    ),
    'xy_circle': Row(
        convert_xy_circle.sessions, ('day1_a', 'day1_b'), ('day2_a',), 'µm', 'V', CIRCLE
    ),
}  # fmt: skip


def diagnosed(row: Row, folder: Path) -> dict[str, Any]:
    """Verdict, causes, channels and figures of one row, as plain values."""
    sessions = row.sessions(folder)
    fit, held_out = ([sessions[n] for n in names] for names in (row.fit, row.held_out))
    content = fit[0].twin
    assert content is not None
    found = diagnose(fit, held_out, TwinFile.from_dict(content), progress=_say)
    accepted = [c for c in found.causes if c.effect in found.verdict]
    return {
        'verdict': found.verdict,
        'causes': [
            {
                'effect': c.effect,
                'probability': c.probability,
                'parameters': c.parameters,
                'shrink': [c.shrink, *c.interval],
                'alternatives': c.alternatives,
            }
            for c in accepted
        ],
        'channels': {
            n: [c.rms('before'), c.rms('after'), c.unit] for n, c in found.channels.items()
        },
        'whole': _whole(found),
        'wandering': {n: _wandering(sessions[n]) for n in (*row.fit, *row.held_out)},
        'warnings': found.warnings,
    }


def _say(message: str) -> None:
    print(f'  {message}', file=sys.stderr, flush=True)


def _whole(found: Diagnosis) -> dict[str, dict[str, float]]:
    """RMS of every channel over the whole of each record of a servo twin, with all causes."""
    if found.twin.kind != 'servo':
        return {}
    return {
        r.name: {
            n: float(np.sqrt(np.mean(g[r.time > 0.5] ** 2)))
            for n, g in replay(r, found.twin, found.effects).items()
        }
        for r in found.records
    }


def _wandering(session: Session) -> float:
    """RMS [m] of the reference less the encoder of x, without its mean, after one second."""
    reference, encoder = (
        session.series[t].values['position.x'] for t in ('/stage/reference', '/stage/joint_states')
    )
    gap = (reference - encoder)[session.seconds('/stage/reference') > 1.0]
    return float(np.std(gap))


def page(rows: Mapping[str, dict[str, Any]]) -> str:
    """The page, from the rows that are there; it names the commits that made them."""
    codes = sorted({row['code'] for row in rows.values()})
    lines = [
        '# The diagnosis on records of machines that others built',
        '',
        'Each row is one diagnosis as a user starts it: a twin with what is published of '
        'the machine, records that fit, and others, or later windows, that judge. The last '
        'column is what the authors of a record say of it. The licences do not let the '
        'project ship the data; [bags](../concepts/bags.md#real-measurements) names '
        'their sources.',
        '',
        '    python -m benchmarks.real_records --out build/real_records',
        '',
        f'Commit {", ".join(codes)}, {time.strftime("%Y-%m-%d")}. The effects speak of metres and '
        'newtons. In the records of rotary axes (`ess_tank`, `slow2`) a metre stands for a '
        'radian, and in `slow2` a newton for an ampere.',
        '',
        '| record | held out | verdict, probability | gap, held out | the authors |',
        '|---|---|---|---|---|',
        *(_line(n, rows[n]) for n in ROWS if n in rows),
        '',
        '## What was found',
        '',
        *(line for n in ROWS if n in rows for line in _details(n, rows[n])),
    ]
    return '\n'.join(_wrapped(line) for line in lines)


def _wrapped(line: str) -> str:
    """Prose in lines of 99 characters; tables, headings and commands as they are."""
    indent = '  ' if line.startswith('- ') else ''
    kept = line.startswith(('|', '#', '    '))
    return (
        line if kept else textwrap.fill(line, 99, subsequent_indent=indent, break_on_hyphens=False)
    )


def _line(name: str, found: Mapping[str, Any]) -> str:
    row = ROWS[name]
    named = [f'`{c["effect"]}` {c["probability"]:.2f}' for c in found['causes']]
    named += ['`unknown`'] if 'unknown' in found['verdict'] and not _unknown(found) else []
    held = ', '.join(f'`{n}`' for n in row.held_out) or (
        'every third rest' if name == 'ess_stops' else 'the last third of every 10 s'
    )
    gaps = [_gap(row, n, *values) for n, values in found['channels'].items()]
    fit = ', '.join(f'`{n}`' for n in row.fit)
    return f'| {fit} | {held} | {", ".join(named)} | {"; ".join(gaps)} | {row.word} |'


def _unknown(found: Mapping[str, Any]) -> bool:
    return any(c['effect'] == 'unknown' for c in found['causes'])


def _gap(row: Row, name: str, before: float, after: float, unit: str) -> str:
    factor = 1e6 if unit == 'm' and row.unit.startswith('µ') else 1.0
    said = row.unit if unit == 'm' else row.effort
    return f'{name} {factor * before:.3g} → {factor * after:.3g} {said}'


def _details(name: str, found: Mapping[str, Any]) -> list[str]:
    row = ROWS[name]
    out = [f'### {", ".join(row.fit)}', '']
    for cause in found['causes']:
        if not cause['parameters']:
            continue
        values = parameter_words(cause['effect'], cause['parameters'])
        share, low, high = (100.0 * x for x in cause['shrink'])
        others = ', '.join(f'`{a}`' for a in cause['alternatives']) or 'none'
        out.append(
            f'- `{cause["effect"]}`: {values}. It closes {share:.0f} % [{low:.0f}, {high:.0f}] of '
            f'the gap. Not told from: {others}.'
        )
    for record, gaps in found['whole'].items():
        said = ', '.join(
            f'{1e6 * v:.2f} µm' if n.startswith('encoder') else f'{v:.2f} N'
            for n, v in gaps.items()
        )
        out.append(f'- The corrected twin over all of `{record}` but its first 0.5 s: {said} RMS.')
    if name.startswith('odrive'):
        strayed = ', '.join(
            f'`{n}` {v * convert_odrive_cogging.COUNTS / 2.0 / np.pi:.0f}'
            for n, v in found['wandering'].items()
        )
        out.append(f'- The position strays from a constant speed by, in counts RMS: {strayed}.')
        out += _orders(found)
    out += [f'- {REMARKS[name]}'] if name in REMARKS else []
    return [*out, *(f'- Said beside it: {w}.' for w in dict.fromkeys(found['warnings'])), '']


def _orders(found: Mapping[str, Any]) -> list[str]:
    """The waves of a ripple as multiples of a turn."""
    for cause in found['causes']:
        values = {k: v for k, (v, _) in cause['parameters'].items()}
        if not cause['effect'].startswith('force_ripple'):
            continue
        first = 2.0 * np.pi / values['period']
        waves = [(first, values['amplitude'])]
        waves += [(k * first, values[f'amplitude_{k}']) for k in range(2, HARMONICS + 1)]
        for key in [k for k in values if k.startswith('wave_period')]:
            waves.append((2.0 * np.pi / values[key], values[key.replace('period', 'amplitude')]))
        said = ', '.join(f'{order:.2f} ({size:.3f} A)' for order, size in waves)
        return [f'- Harmonics of a turn: {said}.']
    return []


def _fresh(name: str) -> dict[str, Any]:
    return diagnosed(ROWS[name], data_folder())


@command_line
def main(arguments: Sequence[str] | None = None) -> int:
    """Diagnose the rows that are not there yet, and write the page.

    Raises
    ------
    StageError
        If the measurements are absent.
    """
    parser = argparse.ArgumentParser(description='The diagnosis on real records.')
    parser.add_argument('--out', type=Path, required=True, help='folder of the rows')
    parser.add_argument('--only', nargs='*', choices=[*ROWS], default=[*ROWS])
    parser.add_argument('--page', type=Path, default=PAGE)
    parsed = parser.parse_args(arguments)
    parsed.out.mkdir(parents=True, exist_ok=True)
    for name in parsed.only:
        print(name, file=sys.stderr, flush=True)
        kept(parsed.out / f'{name}.json', functools.partial(_fresh, name))
    files = {n: parsed.out / f'{n}.json' for n in ROWS}
    rows = {n: json.loads(p.read_text(encoding='utf-8')) for n, p in files.items() if p.exists()}
    parsed.page.write_text(page(rows) + '\n', encoding='utf-8')
    return 0


if __name__ == '__main__':
    sys.exit(main())
