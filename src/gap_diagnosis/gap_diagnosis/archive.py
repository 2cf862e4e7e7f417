"""Diagnoses of an archive: every bag by itself, and what they have in common."""

from __future__ import annotations

import functools
import json
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from gap_diagnosis import service
from session_bags.archive import Outcome, Where, find_bags, map_bags
from stage_core.errors import StageError
from stage_core.whole_file import write_whole


def diagnose_archive(
    archive: str | Path,
    twin: str,
    out: Path,
    how: dict[str, Any] | None = None,
    where: Where | None = None,
) -> str:
    """Diagnose every bag of a folder; returns the table that the command prints.

    A bag's report goes into `out/reports/`, under its path in the archive; `out/summary.json`
    has a line per bag. What is done is kept in `out/results`, see
    `session_bags.archive.map_items`; `how` holds options of `service.run`: `seed`, `without`,
    `with_page`, `travel`.

    Raises
    ------
    StageError
        If the twin cannot be read, there is no bag, none can be diagnosed, or `out` cannot be
        written into.
    """
    root = Path(archive).resolve()
    bags = find_bags(root)
    work = functools.partial(
        diagnose_bag,
        root=str(root),
        twin=str(Path(twin).resolve()),
        out=str(out.resolve()),
        how=how or {},
    )
    service.empty(out)
    try:
        settings = Path(twin).read_text(encoding='utf-8') + json.dumps(how or {}, sort_keys=True)
    except OSError as error:
        raise StageError(f'cannot read {twin} ({error.strerror}): give a twin file') from error
    outcomes = map_bags(work, bags, out / 'results', settings, where)
    names = [str(bag.relative_to(root)) for bag in bags]
    rows = [
        {'bag': name, **(outcome.result or {'skipped': outcome.error})}
        for name, outcome in zip(names, outcomes, strict=True)
    ]
    write_whole(out / 'summary.json', json.dumps(rows, indent=1) + '\n')
    if not any(outcome.result for outcome in outcomes):
        raise StageError(f'no bag can be diagnosed; {names[0]}, for one: {outcomes[0].error}')
    return table(names, outcomes)


def diagnose_bag(bag: str, root: str, twin: str, out: str, how: dict[str, Any]) -> dict[str, Any]:
    """Verdict and gaps [m] of one bag, whose report is written."""
    folder = Path(out) / 'reports' / Path(bag).relative_to(root)
    service.run([bag], [], twin, folder, quiet=True, **how)
    content = json.loads((folder / 'report.json').read_text(encoding='utf-8'))
    return {
        'verdict': content['verdict'],
        'gap_before': content['gap']['before'],
        'gap_after': content['gap']['after'],
        'noise_floor': content['gap']['noise_floor'],
        'report': str(folder.relative_to(out) / 'report.json'),
    }


def table(names: Sequence[str], outcomes: Sequence[Outcome]) -> str:
    """A line per bag, and in how many bags each effect was named."""
    width = max(len(name) for name in names)
    lines = [f'{"held-out gap, RMS [µm]":{width}s} {"before":>9s} {"after":>9s} {"floor":>9s}']
    found: Counter[str] = Counter()
    done = 0
    for name, outcome in zip(names, outcomes, strict=True):
        if outcome.result is None:
            lines.append(f'{name:{width}s} skipped: {outcome.error}')
            continue
        done += 1
        found.update(outcome.result['verdict'])
        gaps = ' '.join(
            # JSON has null for what is not a number.
            '-'.rjust(9) if (gap := outcome.result[key]) is None else f'{1e6 * gap:9.2f}'
            for key in ('gap_before', 'gap_after', 'noise_floor')
        )
        lines.append(f'{name:{width}s} {gaps}  {", ".join(outcome.result["verdict"]) or "none"}')
    lines.append(f'{done} of {len(names)} bags diagnosed')
    lines += [f'{count:5d} of {done}  {effect}' for effect, count in found.most_common()]
    return '\n'.join(lines)
