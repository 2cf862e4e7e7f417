"""docs/interfaces*.md say what the code does: topics, twin file, effects, wires."""

from __future__ import annotations

import dataclasses
import re
import textwrap
from pathlib import Path

import numpy as np
import pytest

from stage_core import drive_link, topics
from stage_core.quantities import UNKNOWN
from stage_core.twin_file import AXIS_TYPES, TwinFile
from stage_driver.zaber_units import ACCELERATION_FACTOR, SPEED_FACTOR
from stage_driver.zaber_words import FLAGS, REJECTIONS
from stage_twin.effects import EFFECTS, link_of
from stage_twin.emulators.zaber_axis import CLEARABLE, UNTIL_NEXT_MOVE
from stage_twin.emulators.zaber_lines import FLAG_ORDER, PACKET_SIZE
from tracker_bridge import tpi
from tracker_bridge.tpi_packets import POINT, POINT_2, MultiMeasurement, SingleMeasurement
from tracker_bridge.tpi_words import (
    Command,
    Event,
    LengthUnit,
    PacketType,
    PointStatus,
    ResultStatus,
)

DOCS = Path(__file__).resolve().parents[1] / 'docs' / 'reference'
PAGE, ZABER, TRACKER = (
    (DOCS / f'{name}.md').read_text(encoding='utf-8')
    for name in ('interfaces', 'interfaces_zaber', 'interfaces_tracker')
)
NAME = re.compile(r'`([\w./]+)`')


def section(title: str, page: str = PAGE) -> str:
    """Text from a heading to the next heading of any level."""
    found = re.search(rf'^#+ {re.escape(title)}\n(.*?)(?=^#|\Z)', page, re.MULTILINE | re.DOTALL)
    assert found is not None, title
    return found[1]


def rows(title: str, page: str = PAGE) -> list[list[str]]:
    """Cells of every row of the tables below a heading."""
    lines = [line for line in section(title, page).splitlines() if line.startswith('| ')]
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
    library = {name for row in told for name in NAME.findall(row[1])}
    assert library
    assert library <= set(EFFECTS)
    assert {link_of(name) for name in library} == {link}


def test_every_effect_has_a_convention() -> None:
    told = {name for row in rows('Conventions') for name in NAME.findall(row[0])}
    assert {name.partition('.')[0] for name in told} <= set(EFFECTS)
    listed = {name for row in rows('Names') for name in NAME.findall(row[1])}
    assert listed == {name.partition('.')[0] for name in told}


def test_names_without_an_axis() -> None:
    text = section('Effects')
    for name in (*(e.name for e in EFFECTS.values() if not e.per_axis), UNKNOWN):
        assert f'`{name}`' in text


def test_drive_link() -> None:
    text = section('Drive link')
    assert ', '.join(f'`{name}`' for name in drive_link.SENSORS) in ' '.join(text.split())
    told = {row[0]: row[1] for row in rows('Drive link')}
    for flag in ('LOCKSTEP', 'REPEATED', 'RESET'):
        assert int(told[flag]) == getattr(drive_link, flag)


def test_flags_and_rejections_of_zaber_devices() -> None:
    table = rows('Warning flags', ZABER)
    assert table[1][0].split() == list(FLAG_ORDER)
    assert set(FLAG_ORDER) == set(FLAGS)
    until = {row[1]: set(re.findall(r'\b[A-Z]{2}\b', row[0])) for row in table if len(row) == 2}
    assert until['`warnings clear`'] == CLEARABLE
    assert until['the next move from rest'] == UNTIL_NEXT_MOVE
    assert {row[0].strip('`') for row in rows('Rejections', ZABER)[1:]} <= set(REJECTIONS)


def test_packets_and_units_of_zaber_devices() -> None:
    assert f'at most {PACKET_SIZE} bytes' in section('Long messages', ZABER)
    text = ' '.join(section('Units', ZABER).split())
    assert f'microsteps/s times {SPEED_FACTOR}' in text
    assert f'times {1e4 * ACCELERATION_FACTOR} / 10000' in text


def test_numbers_of_the_tracker_protocol() -> None:
    packets = {int(row[0]): row[1] for row in rows('emScon TPI', TRACKER) if row[0].isdigit()}
    assert set(packets) < set(PacketType)
    numbers = {int(n) for row in rows('emScon TPI', TRACKER)
               if re.fullmatch(r'\d+(, \d+)?', row[1]) for n in row[1].split(', ')}  # fmt: skip
    assert numbers == set(Command) - {Command.UNKNOWN} - {
        Command.SET_STATION_ORIENTATION,
        Command.SET_TRANSFORMATION,
    }
    values = {row[0]: row[1] for row in rows('emScon TPI', TRACKER) if len(row) == 2}
    for name, words in (
        ('length', LengthUnit),
        ('point status', PointStatus),
        ('result status', ResultStatus),
        ('event', Event),
    ):
        assert {int(n) for n in re.findall(r'\b\d+\b', values[name])} == set(words)


def test_sizes_of_the_tracker_packets() -> None:
    three, none = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    single = tpi.encode_single(SingleMeasurement(0, 0, 0, three, none, 0.0, 0.0, 0.0, 0.0))
    multi = tpi.encode_multi(MultiMeasurement(0, 0, 0, 0.0, 0.0, 0.0, np.zeros(0, POINT)))
    told = {row[1]: row[2] for row in rows('emScon TPI', TRACKER) if len(row) == 4}
    assert told['command'] == f'{len(tpi.encode_command(0))} + 4 n'
    assert told['answer'] == f'{len(tpi.encode_answer(0))} + payload'
    assert told['error'] == str(len(tpi.encode_error(0, 0)))
    assert told['status change'] == str(len(tpi.encode_status_change(0)))
    assert told['single measurement'] == str(len(single))
    assert told['multi measurement'] == f'{len(multi)} + {POINT.itemsize} n'
    assert told['multi measurement 2'] == f'{len(multi)} + {POINT_2.itemsize} n'
    assert told['its record'] == str(POINT.itemsize)


def test_places_in_the_records_of_points() -> None:
    told = {row[1]: row[3] for row in rows('emScon TPI', TRACKER) if len(row) == 4}
    layout = f'{told["its record"]}; {told["multi measurement 2"].partition("record: ")[2]}'
    places = [int(place) for place in re.findall(r'(\d+): [if]\d+', layout)]
    assert places == [offset for _, offset in POINT_2.fields.values()]
