"""Rows of a benchmark: kept one by one, told as a table, with the commit that made them."""

from __future__ import annotations

import functools
import json
import subprocess
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

from stage_core.whole_file import write_whole

ROOT = Path(__file__).resolve().parents[1]


def commit() -> str:
    """Hash of the code that is run, with a mark where files differ from it."""

    def git(*words: str) -> str:
        done = subprocess.run(['git', *words], cwd=ROOT, capture_output=True, text=True)
        return done.stdout.strip()

    changed = git('status', '--porcelain', '--untracked-files=no')
    return git('rev-parse', '--short=12', 'HEAD') + (' with changes' if changed else '')


def kept(path: Path, work: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """The row in a file of JSON; `work` makes it where a run before this one has not.

    Its `code` is the commit that made it.
    """
    if not path.exists():
        write_whole(path, json.dumps({**work(), 'code': commit()}, default=float))
    row: dict[str, Any] = json.loads(path.read_text(encoding='utf-8'))
    return row


def cases(
    folder: Path, numbers: Iterable[int], work: Callable[[int], dict[str, Any]]
) -> list[dict[str, Any]]:
    """The rows of numbered cases, each kept in the folder and printed as soon as it is there."""
    folder.mkdir(parents=True, exist_ok=True)
    rows = []
    for number in numbers:
        path = folder / f'case_{number:04d}.json'
        rows.append(kept(path, functools.partial(work, number)))
        print(json.dumps(rows[-1]), flush=True)
    return rows


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A Markdown table."""
    lines = [head, ['---'] * len(head), *rows]
    return '\n'.join('| ' + ' | '.join(cells) + ' |' for cells in lines)
