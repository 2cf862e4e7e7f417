"""Writes the table of results into docs."""

from __future__ import annotations

from collections import Counter
from datetime import date
from pathlib import Path

from .draw import ROOT, stored
from .run import Result

PAGE = ROOT / 'docs' / 'results' / 'mutants.md'
HEAD = """# What the tests catch

A *mutant* is the source with one operator or number changed. If a test then fails, it has caught
the mutant. If none fails, the mutant has survived, and a test is missing there.

    python -m tools.mutants draw --seed 15         # four mutants from every package, 40 in all
    python -m tools.mutants run --seconds {seconds:.0f}     # tries them

The command runs each mutant against the tests of its package, those first that name its function
or module, until a test fails, for at most {seconds:.0f} s. A test that fails without the mutant as
well does not count. `not finished` says that the time was up, `no such place` that the source no
longer has what was to be changed. `tools/mutants/drawn.json` holds the mutants.

{summary}
The table was written on {date}; its last column is the commit of each run.

| place | change | outcome | s | commit |
|---|---|---|---|---|
"""


def write_table(found: list[Result], seconds: float) -> None:
    """Write one row for each mutant of the list that was tried, in the order of the list."""
    by_mutant = {result.mutant: result for result in found}
    tried = [by_mutant[m] for m in stored() if m in by_mutant]
    counts = Counter(result.outcome for result in tried)
    summary = f'{len(tried)} of {len(stored())} tried: '
    summary += ', '.join(f'{n} {outcome}' for outcome, n in sorted(counts.items())) + '.'
    PAGE.write_text(
        HEAD.format(seconds=seconds, summary=summary, date=date.today())
        + ''.join(_row(r) for r in tried)
    )


def _row(result: Result) -> str:
    mutant = result.mutant
    place = f'`{mutant.file.split("/", 2)[-1]}`: `{mutant.function}`'
    change = f'`{_cell(mutant.before)}` → `{_cell(mutant.after)}`'
    outcome = result.outcome
    if result.test:
        file, _, name = result.test.partition('::')
        outcome += f' by `{_cell("::".join(filter(None, (Path(file).name, name))))}`'
    return f'| {place} | {change} | {outcome} | {result.seconds:.0f} | {result.commit} |\n'


def _cell(text: str) -> str:
    """Text on one line, short enough for a cell."""
    line = ' '.join(text.split()).replace('|', '\\|')
    return line if len(line) <= 60 else line[:57] + '...'
