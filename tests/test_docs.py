"""What the documentation names exists: links, executables, modules, files."""

from __future__ import annotations

import functools
import re
from pathlib import Path

import pytest

from ros2_standin.executables import entry_points

from .test_references import headings

ROOT = Path(__file__).resolve().parents[1]
PAGES = [
    ROOT / 'README.md',
    ROOT / 'CHANGELOG.md',
    ROOT / 'CONTRIBUTING.md',
    *sorted((ROOT / 'docs').rglob('*.md')),
    *sorted((ROOT / 'src').glob('*/**/README.md')),
    *sorted((ROOT / 'benchmarks').rglob('README.md')),
    ROOT / 'ros_ws' / 'README.md',
]
LINK = re.compile(r'\]\(([^)\s]+)\)')
RUN = re.compile(r'ros2 run (\w+) (\w+)')
MODULE = re.compile(r'python -m ([\w.]+)')
SCRIPT = re.compile(r'python ((?:benchmarks|examples|tools)/[\w/]+\.py)')
PLACE = re.compile(r'`((?:src|ros_ws|benchmarks|docs|tests|examples|tools)/[\w./-]*)`')
#: What `make clean` removes, or building makes.
MADE = ('ros_ws/build', 'ros_ws/install', 'ros_ws/log')


def each_page(function):
    ids = [str(page.relative_to(ROOT)) for page in PAGES]
    return pytest.mark.parametrize('page', PAGES, ids=ids)(function)


@functools.cache
def executables() -> set[tuple[str, str]]:
    """(package, executable) of every console script."""
    return {(package, name) for package, names in entry_points().items() for name in names}


def module_file(module: str) -> Path | None:
    """File that `python -m module` runs, if it is one of this project."""
    package, *rest = module.split('.')
    for root in (ROOT / package, *ROOT.glob(f'src/*/{package}')):
        place = root.joinpath(*rest)
        for candidate in (place.with_suffix('.py'), place / '__main__.py'):
            if candidate.is_file():
                return candidate
    return None


def test_there_is_something_to_check() -> None:
    assert len(PAGES) > 20
    assert len(executables()) > 12
    assert module_file('gap_diagnosis') is not None
    assert module_file('gap_diagnosis.no_such_module') is None


@each_page
def test_relative_links_resolve(page: Path) -> None:
    for target in LINK.findall(page.read_text(encoding='utf-8')):
        if not re.match(r'\w+:|#', target):
            assert (page.parent / target.partition('#')[0]).exists(), target


@each_page
def test_executables_exist(page: Path) -> None:
    named = RUN.findall(page.read_text(encoding='utf-8'))
    # Words in capitals stand for any package.
    assert {(package, name) for package, name in named if not package.isupper()} <= executables()


@each_page
def test_modules_and_scripts_exist(page: Path) -> None:
    text = page.read_text(encoding='utf-8')
    for module in MODULE.findall(text):
        if module.split('.')[0] not in ('pytest', 'pip', 'venv', 'zipfile'):
            assert module_file(module.rstrip('.')) is not None, module
    for script in SCRIPT.findall(text):
        assert (ROOT / script).is_file(), script


@each_page
def test_files_named_exist(page: Path) -> None:
    for name in PLACE.findall(page.read_text(encoding='utf-8')):
        if not name.startswith(MADE):
            assert (ROOT / name.rstrip('./')).exists(), name


def test_every_page_is_listed_in_the_index() -> None:
    index = ROOT / 'docs' / 'README.md'
    listed = set(LINK.findall(index.read_text(encoding='utf-8')))
    for page in sorted(index.parent.rglob('*.md')):
        assert page == index or str(page.relative_to(index.parent)) in listed
    assert 'docs/README.md' in LINK.findall((ROOT / 'README.md').read_text(encoding='utf-8'))


def test_the_readme_is_short() -> None:
    lines = (ROOT / 'README.md').read_text(encoding='utf-8').splitlines()
    assert len(lines) <= 120


#: What draws a picture of the docs, and how it names it.
DRAWN = {
    'tools/screenshots.py': r"draw\('(\w+)'",
    'tools/docs_figures.py': r"images / '(\w+)\.png'",
    'benchmarks/paper3_figures.py': r"out / '(\w+)\.png'",
    'benchmarks/paper4_figure.py': r"out / '(\w+)\.webp'",
}


def test_every_picture_is_shown_and_a_command_draws_it() -> None:
    shown = '\n'.join(page.read_text(encoding='utf-8') for page in PAGES)
    drawn = {
        name
        for place, names in DRAWN.items()
        for name in re.findall(names, (ROOT / place).read_text(encoding='utf-8'))
    }
    tutorials = {file.stem for file in (ROOT / 'docs' / 'guide' / 'tutorials').glob('*.py')}
    pictures = sorted((ROOT / 'docs' / 'images').iterdir())
    assert pictures
    for picture in pictures:
        assert f'images/{picture.name})' in shown, picture.name
        tutorial = re.fullmatch(r'tutorial_(\w+)_\d+', picture.stem)
        assert tutorial[1] in tutorials if tutorial else picture.stem in drawn, picture.name


#: Words that the guide uses as if everybody knew them.
TERMS = ('gap', 'floor', 'held-out', 'rest', 'lead', 'lockstep')


def test_the_glossary_has_what_the_readme_shows() -> None:
    glossary = (ROOT / 'docs' / 'reference' / 'glossary.md').read_text(encoding='utf-8')
    rows = re.findall(r'^\| (.+?) \|', glossary, re.MULTILINE)
    explained = {term.strip() for row in rows for term in row.split(',')}
    assert rows[1:] == sorted(rows[1:], key=str.lower)
    assert set(TERMS) <= explained
    named = (ROOT / 'README.md').read_text(encoding='utf-8').partition('diagnosis: ')[2]
    effects = re.findall(r'([\w ]+?)(?: of [xy])? \(p', ' '.join(named.split()))
    assert effects and {effect.strip() for effect in effects} <= explained


def prose(page: Path) -> list[str]:
    """Lines without what cannot be wrapped: blocks of code and rows of tables become empty."""
    text = re.sub(r'^```.*?^```', '', page.read_text(encoding='utf-8'), flags=re.DOTALL | re.M)
    # Four spaces after an empty line or a mark are code, after text they are a list in a list.
    text = re.sub(r'(?:(?<=\n\n)|(?<=-->\n))(?: {4}.*\n+)+', '\n', text)
    return re.sub(r'^\|.*$', '', text, flags=re.M).splitlines()


@each_page
def test_lines_fit_the_screen(page: Path) -> None:
    assert [line for line in prose(page) if len(line) > 100] == []


#: Its items are the parameters that the command has found.
FOUND = ROOT / 'docs' / 'results' / 'real_records.md'


@each_page
def test_paragraphs_are_short(page: Path) -> None:
    length = 0
    for line in prose(page) if page != FOUND else []:
        begins = re.match(r' *([-*]|\d+\.) ', line)
        ends = not line.strip() or line.startswith(('#', '<!--'))
        length = 0 if ends else 1 if begins else length + 1
        assert length <= 5, line


@each_page
def test_anchors_exist(page: Path) -> None:
    for target in LINK.findall(page.read_text(encoding='utf-8')):
        name, _, anchor = target.partition('#')
        if anchor and not re.match(r'\w+:', target):
            assert anchor in headings(page.parent / name if name else page), target


@each_page
def test_no_marker_is_left(page: Path) -> None:
    """No place that still waits for its text."""
    for line in page.read_text(encoding='utf-8').splitlines():
        assert not re.fullmatch(r'@@\w*|@@\w+@@|[A-Z]{2,}\d*', line.strip()), line
