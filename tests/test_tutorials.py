"""The tutorials run, and their pages hold the cells that they have now."""

from __future__ import annotations

import runpy
from pathlib import Path

import pytest

from .test_figures import different

ROOT = Path(__file__).resolve().parents[1]
TOOL = runpy.run_path(str(ROOT / 'tools' / 'notebooks.py'))
ALL = sorted(TOOL['TUTORIALS'].glob('*.py'))


def test_there_are_four() -> None:
    assert len(ALL) == 4


@pytest.mark.parametrize('tutorial', ALL, ids=lambda path: path.stem)
def test_the_page_is_of_these_cells(tutorial: Path) -> None:
    page = tutorial.with_suffix('.md').read_text(encoding='utf-8')
    for kind, text in TOOL['cells'](tutorial.read_text(encoding='utf-8')):
        wanted = text if kind == 'markdown' else f'```python\n{text}\n```'
        assert wanted in page, f'{tutorial.stem}: run make tutorials'


def test_one_tutorial_runs(tmp_path: Path) -> None:
    """The shortest; `make soak` runs all."""
    tutorial = TOOL['TUTORIALS'] / 'own_tracker.py'
    page = TOOL['write'](tutorial, tmp_path).read_text(encoding='utf-8')
    assert '519 points, 1 duplicate' in page
    written = tutorial.with_suffix('.md').read_text(encoding='utf-8')
    assert different(page, written) == [], 'run make tutorials'
    picture = tmp_path / 'images' / 'tutorial_own_tracker_1.webp'
    assert picture.read_bytes()[:4] == b'RIFF' and f'../../images/{picture.name}' in page
