"""Rows of the tables and how they are printed."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Entry:
    """One figure of a table of paper 4 beside the one computed here, both in the unit given.

    ``paper`` is the text as printed, since some entries are bounds such as ``<0.01``.
    """

    row: str
    column: str
    paper: str
    here: float
    unit: str = ''
    reason: str = ''


def format_number(value: float) -> str:
    """Four figures, in powers of ten only where needed."""
    return f'{value:.4g}'


def format_table(header: list[str], rows: list[list[str]]) -> str:
    """Columns set with spaces; the last one is left free to run."""
    widths = [max(len(line[k]) for line in [header, *rows]) for k in range(len(header))]
    lines = ['  '.join(cell.ljust(width) for cell, width in zip(header, widths, strict=True))]
    lines.append('  '.join('-' * width for width in widths))
    for row in rows:
        lines.append('  '.join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)))
    return '\n'.join(line.rstrip() for line in lines)


def format_entries(entries: list[Entry]) -> str:
    """Table of entries: paper, here, and why they differ where they do."""
    rows = [[e.row, e.column, e.paper, format_number(e.here), e.unit, e.reason] for e in entries]
    return format_table(['case', 'method', 'paper', 'here', 'unit', 'difference'], rows)
