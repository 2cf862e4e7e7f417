"""Every figure of README and docs is written by a command, compared, or somebody else's.

Pages of `docs/results` carry command, commit and date (`test_figures.py`). A figure here is a
number with a unit, a decimal point or two digits.
"""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from .stated_figures import GIVEN, ROOT, STATED
from .test_figures import ORIGIN, TOOL

DOCS = ROOT / 'docs'
#: Pages that a command writes whole, each compared with it by a test of its own.
WRITTEN = {DOCS / 'reference' / 'reference.md'}
PAGES = [
    page
    for page in (ROOT / 'README.md', *sorted(DOCS.rglob('*.md')))
    if page.parent.name != 'results' and page not in WRITTEN
    and not page.with_suffix('.py').exists()
]  # fmt: skip
UNIT = r'(?:[µnm]?m|[µm]?s|k?Hz|N|kg|K|°C|%|bytes|[KMG]iB|baud|ticks|min)'
FIGURE = re.compile(rf'(?<![\w.])(?:\d+[.,]\d+|\d{{2,}}|\d+ {UNIT}(?!\w))')
#: Not figures of a page: what commands write, code, links, standards, publications and dates.
OTHER = [
    re.compile(pattern, re.DOTALL | re.MULTILINE)
    for pattern in (
        r'<!-- (?:prints|session).*?<!-- end -->',
        r'^ *```.*?^ *```',
        r'(?:(?<=\n\n)|(?<=-->\n))(?: {4}.*\n+)+',
        # The effects, as `python -m stage_twin.effects` prints them (`test_command.py`).
        r'^### servo$.*',
        r'^## What the paper says$.*?(?=^## )',
        r'`[^`]*`|\]\([^)]*\)|<http[^>]*>|127\.0\.0\.1',
        r'ISO(?:/TR)? [\d-]+(?: and [\d-]+)?|REP-\d+|Python 3[\d.]+(?: to 3[\d.]+)?|95 %',
        r'[Ee]qs?\. [\d, and–to]+|figure \d+',
        r'\*[^*\n]+\* \d+(?: \(\d{4}\) \d+)?|[*\n]Magazine\* \d+',
        r'\b(?:19|20)\d\d\b(?!-)',
    )
]
#: Tables that `test_interfaces.py` compares.
COMPARED = {
    'reference/interfaces.md': ('Twin file', 'Drive link'),
    'reference/interfaces_tracker.md': ('emScon TPI',),
    'reference/interfaces_zaber.md': ('Warning flags', 'Rejections'),
}


def name(page: Path) -> str:
    """A page as `STATED` names it."""
    return str(page.relative_to(ROOT if page.parent == ROOT else DOCS))


def left(page: Path, text: str) -> list[str]:
    """Paragraphs with a figure that nothing writes or compares."""
    for title in COMPARED.get(name(page), ()):
        begin = text.index(f'# {title}\n')
        end = text.find('\n## ', begin)
        text = text[:begin] + re.sub(r'^\|.*', '', text[begin:end], flags=re.M) + text[end:]
    for sentence in (*STATED.get(name(page), ()), *GIVEN.get(name(page), ())):
        words = map(re.escape, sentence.split())
        text = re.sub(r'\s+'.join(words), 'stated', text)
    for pattern in OTHER:
        text = pattern.sub(' ', text)
    found = [part for part in text.split('\n\n') if FIGURE.search(part)]
    return [part for part in found if not all(mark.search(part) for mark in ORIGIN)]


@pytest.mark.parametrize('page', STATED)
def test_stated_figures_are_those_of_the_code(page: str) -> None:
    place = ROOT if page == 'README.md' else DOCS
    text = ' '.join((place / page).read_text(encoding='utf-8').split())
    assert [sentence for sentence in STATED[page] if sentence.strip() not in text] == []


@pytest.mark.parametrize('page', PAGES, ids=name)
def test_every_figure_is_written_or_compared(page: Path) -> None:
    assert left(page, page.read_text(encoding='utf-8')) == []


def test_a_figure_that_nothing_compares_is_found() -> None:
    page = ROOT / 'README.md'
    assert left(page, 'It takes\n`12 s`, and 34 ms.') != []
    assert left(page, 'It takes `12 s`.') == []
    assert left(page, 'It takes 34 ms (commit 4491ce6, 2026-11-25).') == []


def test_every_place_of_a_command_has_its_end() -> None:
    pages = [page.read_text(encoding='utf-8') for page in DOCS.rglob('*.md')]
    marks = sum(len(re.findall('^<!-- prints ', text, re.M)) for text in pages)
    assert marks == len(list(TOOL['places']()))
