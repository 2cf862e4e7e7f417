"""The tutorials run, and their pages hold the cells that they have now."""

from __future__ import annotations

import os
import runpy
from pathlib import Path

import pytest

from .test_figures import ORIGIN, different

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


#: `make test` runs the shortest, `make soak` all.
RUN = ALL if os.environ.get('TUTORIALS') == 'all' else [TOOL['TUTORIALS'] / 'own_tracker.py']


@pytest.mark.parametrize('tutorial', RUN, ids=lambda path: path.stem)
def test_a_tutorial_makes_its_page(tutorial: Path, tmp_path: Path) -> None:
    page = TOOL['write'](tutorial, tmp_path).read_text(encoding='utf-8')
    written, _, source = tutorial.with_suffix('.md').read_text('utf-8').partition('\n*Written by')
    assert different(page, written) == [], 'run make tutorials'
    assert all(mark.search(source) for mark in ORIGIN)
    pictures = sorted((tmp_path / 'images').glob(f'tutorial_{tutorial.stem}_*.webp'))
    assert pictures
    for picture in pictures:
        assert picture.read_bytes()[:4] == b'RIFF' and f'../../images/{picture.name}' in page
