"""The figures that the docs print come from their commands: the cheap ones are compared here.

Expensive figures carry their commit and date on the page instead.
"""

from __future__ import annotations

import re
import runpy
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
DOCS_FIGURES = runpy.run_path(str(ROOT / 'tools' / 'docs_figures.py'))
TOOL = runpy.run_path(str(ROOT / 'tools' / 'printed.py'))
PLACES = list(TOOL['places']())
NUMBER = re.compile(r'(?<![\w.])[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?')
#: How long a step took, on the machine that wrote the page.
SECONDS = re.compile(r'\d+\.\d+ s\b')
#: Below this only the rounding of the processor is left, in m, µm and kelvin alike.
ROUNDING = 1e-8


def parts(line: str) -> tuple[list[str], list[float]]:
    """Words and numbers of a line."""
    line = SECONDS.sub('', line)
    return NUMBER.sub('#', line).split(), [float(n) for n in NUMBER.findall(line)]


def alike(line: str, other: str) -> bool:
    """Whether two lines say the same, to a hundredth of each number."""
    (words, numbers), (others, theirs) = parts(line), parts(other)
    return words == others and numbers == pytest.approx(theirs, rel=0.01, abs=ROUNDING)


def different(printed: str, page: str) -> list[str]:
    """Lines that are printed and that the page does not have at that place."""
    lines, others = printed.splitlines(), page.splitlines()
    others += [''] * (len(lines) - len(others))
    extra = others[len(lines) :]
    return [
        line for line, other in zip(lines, others, strict=False) if not alike(line, other)
    ] + extra


def test_a_figure_of_another_state_is_seen() -> None:
    page = 'held-out RMS 0.703 µm (15 t 0.10 s)\nround-off 1.7e-16'
    assert different('held-out RMS 0.704 µm (15 t 0.55 s)\nround-off 2.9e-17', page) == []
    assert different('held-out RMS 0.753 µm (15 t 0.10 s)\nround-off 1.7e-16', page) != []
    assert different('held-out MAE 0.703 µm (15 t 0.10 s)\nround-off 1.7e-16', page) != []
    assert different('held-out RMS 0.703 µm (15 t 0.10 s)', page) != []


@pytest.mark.parametrize(
    'place', PLACES, ids=[f'{page.stem}: {found[2]}' for page, found in PLACES]
)
def test_the_page_holds_what_the_command_prints(place: tuple[Path, re.Match[str]]) -> None:
    _, found = place
    assert different(TOOL['printed'](found), found[3]) == []


def test_every_table_of_the_papers_is_written() -> None:
    papers = (ROOT / 'docs' / 'results' / 'papers.md').read_text(encoding='utf-8')
    written = [found[3] for _, found in PLACES if found.string == papers]
    assert sum(text.count('\n') + 1 for text in written) == len(re.findall(r'^\|', papers, re.M))


#: A section of results shows a table or an output; one that no command writes has these.
SHOWS = re.compile(r'^\|[ :-]+\||^```', re.M)
ORIGIN = (
    re.compile(r'\b(?=\d*[a-f]|[a-f]*\d)[0-9a-f]{7,12}\b'),
    re.compile(r'\b20\d\d-\d\d-\d\d\b'),
)
COMMAND = re.compile(r'^ {4}\S|`(make|python) ', re.M)
RESULTS = sorted((ROOT / 'docs' / 'results').glob('*.md'))


@pytest.mark.parametrize('page', RESULTS, ids=[page.stem for page in RESULTS])
def test_what_no_command_writes_has_its_command_commit_and_date(page: Path) -> None:
    text = TOOL['PLACE'].sub('', page.read_text(encoding='utf-8'))
    top, *sections = re.split(r'^## ', text, flags=re.M)
    for section in filter(SHOWS.search, sections):
        for wanted in (*ORIGIN, COMMAND):
            assert wanted.search(top + section), section.splitlines()[0]


def test_the_example_names_what_the_emulated_machine_has() -> None:
    page = (ROOT / 'docs' / 'guide' / 'diagnosis_reading.md').read_text(encoding='utf-8')
    table = page.partition('| planted |')[2].partition('\n\n')[0].splitlines()[2:]
    rows = [line.strip('| ').split(' | ') for line in table]
    shown = {(effect, name): value for effect, name, value, _ in rows if value != 'not planted'}
    assert shown
    assert shown.items() <= DOCS_FIGURES['planted']().items()
