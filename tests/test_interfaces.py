"""docs/interfaces.md says what the code does: topics, twin file, effects, drive link."""

from __future__ import annotations

import dataclasses
import re
import textwrap
from pathlib import Path

import pytest

from stage_core import drive_link, topics
from stage_core.quantities import UNKNOWN
from stage_core.twin_file import AXIS_TYPES, TwinFile
from stage_twin.effects import EFFECTS, link_of

PAGE = Path(__file__).resolve().parents[1] / 'docs' / 'interfaces.md'
TEXT = PAGE.read_text(encoding='utf-8')
NAME = re.compile(r'`([\w./]+)`')


def section(title: str) -> str:
    """Text from a heading to the next heading of any level."""
    found = re.search(rf'^#+ {re.escape(title)}\n(.*?)(?=^#|\Z)', TEXT, re.MULTILINE | re.DOTALL)
    assert found is not None, title
    return found[1]


def rows(title: str) -> list[list[str]]:
    """Cells of every row of the tables below a heading."""
    lines = [line for line in section(title).splitlines() if line.startswith('| ')]
    return [[cell.strip() for cell in line.strip('|').split(' | ')] for line in lines]


def test_topics_and_types() -> None:
    told = {NAME.findall(row[0])[0]: row[1] for row in rows('Topics') if row[0] != 'topic'}
    types = {name: kind.replace('/msg/', '/') for name, kind in topics.TOPIC_TYPES.items()}
    assert told == types
    latched = next(row for row in rows('Quality of service') if 'transient local' in row)
    assert set(NAME.findall(latched[0])) >= topics.LATCHED


def test_the_twin_file_of_the_page_runs(tmp_path: Path) -> None:
    example = re.search(r'^    kind: servo\n(?:    .*\n)+', section('Twin file'), re.MULTILINE)
    assert example is not None
    path = tmp_path / 'twin.yaml'
    path.write_text(textwrap.dedent(example[0]), encoding='utf-8')
    twin = TwinFile.load(path, with_gains=True)
    assert twin.axes == TwinFile.nominal_servo().axes
    assert set(twin.effects) == {'backlash.x'}


def test_keys_of_a_twin_file() -> None:
    told = {row[0].strip('`'): row for row in rows('Twin file')}
    for kind, axis in AXIS_TYPES.items():
        for key in dataclasses.fields(axis):
            assert kind in told[key.name][2] or told[key.name][2] == 'all', key.name
            if key.default is dataclasses.MISSING:
                assert told[key.name][3].startswith('refused')
            else:
                numbers = re.findall(r'[\d.]+(?:e-?\d+)?', told[key.name][3])
                assert key.default in map(float, numbers), key.name
    for key in TwinFile.nominal_servo().to_dict():
        assert key in {name.partition('.')[0] for name in told}


@pytest.mark.parametrize('link', ['servo', 'kinematic', 'sensor'])
def test_effects_have_the_names_and_links_of_the_page(link: str) -> None:
    told = [row for row in rows('Names') if row[0].startswith(link)]
    library = {name for row in told if len(row) == 2 for name in NAME.findall(row[1])}
    fixed = {name for row in told if len(row) == 3 for name in NAME.findall(row[1])}
    assert library and fixed
    assert library <= set(EFFECTS)
    assert {link_of(name) for name in library | (fixed & set(EFFECTS))} == {link}


def test_every_effect_has_a_convention() -> None:
    told = {name for row in rows('Conventions') for name in NAME.findall(row[0])}
    assert {name.partition('.')[0] for name in told} <= set(EFFECTS)
    listed = {name for row in rows('Names') if len(row) == 2 for name in NAME.findall(row[1])}
    assert listed == {name.partition('.')[0] for name in told}


def test_names_without_an_axis() -> None:
    text = section('Effects')
    for name in (*(e.name for e in EFFECTS.values() if not e.per_axis), UNKNOWN):
        assert f'`{name}`' in text


def test_drive_link() -> None:
    text = section('Drive link')
    assert f'header, {drive_link.HEADER.size} bytes' in text
    assert f'port {drive_link.DEFAULT_PORT}' in text
    assert ', '.join(f'`{name}`' for name in drive_link.SENSORS) in ' '.join(text.split())
    told = {row[0]: row[1] for row in rows('Drive link')}
    for flag in ('LOCKSTEP', 'REPEATED', 'RESET'):
        assert int(told[flag]) == getattr(drive_link, flag)
