"""The results of the blind check of the law as a page."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path


def page(folder: Path, no_function: Sequence[str]) -> str:
    """Markdown of docs/results/law.md from the rows in a folder."""
    return ''
