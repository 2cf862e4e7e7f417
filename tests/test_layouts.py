"""The layouts for Foxglove and PlotJuggler show what a session holds, in their tools' words."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from session_bags.bag import open_bag
from session_bags.definitions import definition
from session_bags.info import contents
from session_bags.writer import write_session
from stage_core import topics
from stage_core.session import Series, Session

ROOT = Path(__file__).resolve().parents[1]
LAYOUTS = ROOT / 'ros_ws' / 'config' / 'layouts'
FOXGLOVE = sorted(LAYOUTS.glob('foxglove_*.json'))
JOINT_STATE = 'sensor_msgs/msg/JointState'

#: Keys of each panel's configuration: packages/suite-base/src/panels of Lichtblick, the open
#: fork of Foxglove Studio, at commit 66adecb99 (August 2026), and the titles of both tools.
TITLES = {'foxglovePanelTitle', 'lichtblickPanelTitle'}
PANELS = {
    'Plot': 'paths minXValue maxXValue minYValue maxYValue showLegend legendDisplay isSynced '
    'showPlotValuesInLegend showXAxisLabels showYAxisLabels xAxisVal xAxisPath xAxisLabel '
    'yAxisLabel followingViewWidth sidebarDimension',
    'DiagnosticSummary': 'minLevel pinnedIds topicToRender hardwareIdFilter sortByLevel '
    'secondsUntilStale',
    'RawMessages': 'diffEnabled diffMethod diffTopicPath expansion showFullMessageForDiff '
    'topicPath fontSize',
    # editingMode and timeoutSeconds are Foxglove's; Lichtblick passes over them.
    'CallService': 'serviceName requestPayload layout buttonText buttonTooltip buttonColor '
    'editingMode timeoutSeconds',
    'Parameters': '',
}
X_AXES = {'timestamp', 'index', 'custom', 'currentCustom'}
LEGENDS = {'floating', 'top', 'left', 'none'}


def load(path: Path) -> dict[str, Any]:
    return json.loads(path.read_text(encoding='utf-8'))


def leaves(node: Any) -> list[str]:
    """Panels of a mosaic."""
    if isinstance(node, str):
        return [node]
    assert node['direction'] in ('row', 'column')
    return leaves(node['first']) + leaves(node['second'])


def plotted(content: dict[str, Any]) -> list[str]:
    """Every message path of a Foxglove layout."""
    found = []
    for config in content['configById'].values():
        found += [path['value'] for path in config.get('paths', [])]
        found += [config[k]['value'] for k in ('xAxisPath',) if k in config]
        found += [config[k] for k in ('topicPath', 'topicToRender') if k in config]
    return found


def fields(type_name: str, part: str = '') -> dict[str, str]:
    """Type of each field of a message type, from the definition that bags embed."""
    text, _ = definition(type_name)
    sections = {'': ''}
    name = ''
    for line in text.splitlines():
        if line.startswith('MSG: '):
            name = line[5:].replace('/msg/', '/')
            sections[name] = ''
        elif not line.startswith('='):
            sections[name] += line + '\n'
    words = (line.split('#')[0].split() for line in sections[part].splitlines())
    return {w[1]: w[0] for w in words if len(w) == 2 and '=' not in w[1]}


def resolve(type_name: str, path: str) -> str:
    """Type of what a path as `.point.x` or `.position[0]` leads to."""
    part, kind = '', ''
    for step in re.findall(r'\.(\w+)(\[\d+\])?', path):
        known = fields(type_name, part)
        assert step[0] in known, f'{type_name} has no {path}'
        kind = known[step[0]]
        assert kind.endswith(']') == bool(step[1]), path
        part = kind.replace('/msg/', '/')
        if '/' not in part and part[:1].isupper():
            part = f'{type_name.split("/")[0]}/{part}'
    return kind


def test_there_are_layouts() -> None:
    assert [path.stem for path in FOXGLOVE] == ['foxglove_live', 'foxglove_recorded']
    assert resolve('geometry_msgs/msg/PointStamped', '.point.x') == 'float64'
    with pytest.raises(AssertionError):
        resolve('geometry_msgs/msg/PointStamped', '.point.w')


@pytest.mark.parametrize('path', FOXGLOVE, ids=lambda p: p.stem)
def test_foxglove_panels(path: Path) -> None:
    """Each panel is placed once, is of a kind that exists, and is configured in its words."""
    content = load(path)
    assert sorted(leaves(content['layout'])) == sorted(content['configById'])
    for name, config in content['configById'].items():
        kind = name.partition('!')[0]
        assert set(config) <= {*PANELS[kind].split()} | TITLES, name
        if kind == 'Plot':
            assert config['xAxisVal'] in X_AXES and config['legendDisplay'] in LEGENDS
            assert ('xAxisPath' in config) == (config['xAxisVal'] == 'custom')
            for curve in config['paths']:
                assert curve['timestampMethod'] in ('receiveTime', 'headerStamp')


@pytest.mark.parametrize('path', FOXGLOVE, ids=lambda p: p.stem)
def test_foxglove_paths_lead_to_numbers(path: Path) -> None:
    """Topic, filter and field exist in the message definition that a bag embeds."""
    for text in plotted(load(path)):
        found = re.fullmatch(r'(/[\w/]+)((?:\{[^}]*\})?)((?:\.\w+(?:\[\d+\])?)*)', text)
        assert found, text
        topic, condition, way = found.groups()
        kind = topics.TOPIC_TYPES[topic]
        if condition:
            field, sensor = re.fullmatch(r'\{([\w.]+)=="(\w+)"\}', condition).groups()
            assert resolve(kind, f'.{field}') == 'string'
            assert sensor in ('screw_x', 'screw_y', 'frame', 'air')
        if way:
            assert resolve(kind, way).startswith('float64'), text


def test_buttons_call_services_that_exist() -> None:
    reference = (ROOT / 'docs' / 'reference' / 'reference.md').read_text(encoding='utf-8')
    buttons = load(LAYOUTS / 'foxglove_live.json')['configById'].values()
    names = [c['serviceName'] for c in buttons if 'serviceName' in c]
    assert names
    for name in names:
        node, service = re.fullmatch(r'/(\w+)/(\w+)', name).groups()
        section = reference.partition(f'\n## {node}\n')[2].partition('\n## ')[0]
        assert re.search(rf'`~/{service}`', section), name


def curves() -> set[str]:
    """Every series that the PlotJuggler layout shows."""
    root = ElementTree.parse(LAYOUTS / 'plotjuggler.xml').getroot()
    found: set[str] = set()
    for curve in root.iter('curve'):
        both = {curve.get('curve_x'), curve.get('curve_y')} - {None}
        found |= both or {curve.get('name')}
    return found


def test_plotjuggler_curves_exist() -> None:
    """PlotJuggler names a joint's quantity /topic/joint/quantity, any other field by its path."""
    assert len(curves()) > 12
    for name in curves():
        (topic,) = [t for t in topics.TOPIC_TYPES if name.startswith(t + '/')]
        kind = topics.TOPIC_TYPES[topic]
        way = name[len(topic) + 1 :].split('/')
        if kind == JOINT_STATE:
            assert way[0] in ('x', 'y') and way[1] in ('position', 'velocity', 'effort'), name
        else:
            assert resolve(kind, '.' + '.'.join(way)) == 'float64', name


def test_a_session_bag_holds_what_is_shown(tmp_path: Path) -> None:
    """A session with every topic: what the layouts of a record plot is in the bag."""
    stamps = 10**18 + np.arange(20) * 1_000_000
    column = np.linspace(0.0, 1.0, 20)
    joints = {f'{q}.{a}': column for q in ('position', 'velocity', 'effort') for a in 'xy'}
    series = {}
    for topic, kind in topics.TOPIC_TYPES.items():
        if kind == JOINT_STATE:
            series[topic] = Series(topic, stamps, joints)
    for topic, names in (
        (topics.TRACKER_POINT, 'xyz'),
        (topics.CONTOUR_ERROR, 'xyz'),
    ):
        series[topic] = Series(topic, stamps, dict.fromkeys(names, column))
    for sensor in ('screw_x', 'screw_y', 'frame', 'air'):
        key = topics.temperature_key(sensor)
        series[key] = Series(topics.TEMPERATURE, stamps, {'temperature': column})
    bag = write_session(tmp_path / 'bag', Session('all', series))
    held = {topic for topic, count in contents(open_bag(bag)).counts.items() if count}
    shown = {
        re.match(r'/[\w/]+', p).group() for p in plotted(load(LAYOUTS / 'foxglove_recorded.json'))
    }
    # Recorded from the graph; a bag written from arrays has numeric topics only.
    assert shown - held == {topics.MODEL, topics.DIAGNOSTICS}
    assert all(any(name.startswith(topic + '/') for topic in held) for name in curves())
