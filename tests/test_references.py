"""Every document that the project cites is in the repository, and so is the heading it names.

Published sources and the measurements below `STAGE_DATA` stand outside.
"""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PLACES = ('src', 'tests', 'benchmarks', 'docs', 'examples', 'tools')
ROS = ('config', 'launch', 'layouts')
KINDS = {'.py', '.md', '.yaml', '.xml', '.sh', '.toml', '.in', '.cfg', '.json', '.mjs', '.txt'}
FILES = sorted(
    path
    for place in (*(ROOT / name for name in PLACES), *(ROOT / 'ros_ws' / name for name in ROS))
    for path in place.rglob('*')
    if path.suffix in KINDS and path != Path(__file__)
)
FOLDERS = [ROOT / 'docs' / name for name in ('guide', 'concepts', 'reference', 'results')]
FILES += [path for path in sorted(ROOT.iterdir()) if path.suffix in KINDS | {'.lock'}]
#: Written by a command, not part of the repository.
MADE = {'results.md'}

PAGE = re.compile(r'(?<![\w*])((?:\.{1,2}/)*[\w-]+(?:/[\w-]+)*\.md)\b(#[\w-]+)?')
#: `docs/reference/interfaces.md, "Units"`, also behind the bracket of a link.
HEADING = re.compile(r'([\w-]+\.md)\)?,\s+(?:#\s*)?"([^"\n]+)"')
#: Words for a document that is not named by its file.
NAMELESS = re.compile(
    r'(?:the|project\'s|our) contract\b|contract\'s|contracts?,? section|fact sheets?\b'
    r'|(?<!paper )(?:section|§) ?\d+ of the (?!paper)\w+',
    re.IGNORECASE,
)


def headings(page: Path) -> dict[str, str]:
    """Anchor of each heading of a page, as GitHub makes it, and the heading."""
    found = re.findall(r'^#+ +(.+?)\s*$', page.read_text(encoding='utf-8'), re.MULTILINE)
    kept = {title: re.sub(r'[^\w\- ]', '', title).strip() for title in found}
    return {plain.lower().replace(' ', '-'): title for title, plain in kept.items()}


def wrong_references(text: str, place: Path) -> list[str]:
    """References of a text in the folder `place` to what is not in the repository."""
    text = re.sub(r'https?://\S+', '', text)
    wrong = [match[0] for match in NAMELESS.finditer(text)]
    for name, anchor in PAGE.findall(text):
        if name in MADE:
            continue
        folders = (place, ROOT, ROOT / 'docs', *FOLDERS)
        page = next((f / name for f in folders if (f / name).is_file()), None)
        if page is None or (anchor and anchor[1:] not in headings(page)):
            wrong.append(name + anchor)
    for name, title in HEADING.findall(text):
        page = next((f / name for f in FOLDERS if (f / name).is_file()), None)
        if page is not None and title.rstrip('.,') not in headings(page).values():
            wrong.append(f'{name}, "{title}"')
    return wrong


def test_every_reference_is_in_the_repository() -> None:
    assert len(FILES) > 400
    wrong = {path: wrong_references(path.read_text('utf-8'), path.parent) for path in FILES}
    assert not {str(path.relative_to(ROOT)): found for path, found in wrong.items() if found}


@pytest.mark.parametrize(
    'text',
    [
        'see section 5 of the contract',
        'as the contract names them',
        'units (fact sheet, section 6)',
        'see docs/no_such_page.md',
        '[page](no_such_page.md)',
        '[heading](interfaces.md#no-such-heading)',
        'docs/reference/interfaces.md, "No such heading"',
    ],
)
def test_what_is_not_there_is_found(text: str) -> None:
    assert wrong_references(text, ROOT / 'docs' / 'reference')


@pytest.mark.parametrize(
    'text',
    [
        'section 2 of paper 1',
        'docs/reference/interfaces.md, "Servo controller"',
        '[controller](interfaces.md#servo-controller)',
        "numba's flag 'contract'",
    ],
)
def test_what_is_there_is_not(text: str) -> None:
    assert wrong_references(text, ROOT / 'docs' / 'reference') == []
