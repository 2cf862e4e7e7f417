"""Whether a bag is a session bag (interfaces.md, "Session bag"), and what is wrong."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from session_bags.bag import Bag, open_bag
from session_bags.cdr import JOINT_STATE, NUMERIC_TYPES
from session_bags.columns import TopicDecoder
from session_bags.drops import missing_messages
from session_bags.info import contents
from session_bags.metadata import parse_qos
from session_bags.plausible import check_times, check_tracker, check_units
from session_bags.reader import decode, last_alignment
from session_bags.writer import TWIN_KEY
from stage_core import topics
from stage_core.errors import StageError, command_line
from stage_core.quantities import AXES
from stage_core.session import Series, Session
from stage_core.twin_file import TwinFile
from stage_core.untrusted import yaml_mapping

OK, WARNING, ERROR = 'ok', 'warning', 'error'
#: Quantities that every message of a joint topic holds.
_QUANTITIES = {
    topics.REFERENCE: ('position', 'velocity'),
    topics.JOINT_STATES: ('position', 'velocity'),
}
#: A pause longer than this many periods is a gap.
_GAP = 5.0
#: The slowest stretch is looked for over this many periods, and over a second at least.
_STRETCH = 10.0


@dataclass(frozen=True)
class Finding:
    """One statement about a bag: its level, what it is about, and what to do."""

    level: str
    about: str
    text: str

    def __str__(self) -> str:
        return f'{self.level:<8}{self.about}: {self.text}'


def check_bag(path: str | Path) -> list[Finding]:
    """Check a bag against docs/reference/interfaces.md, "Topics" and "Session bag".

    Raises
    ------
    StageError
        If the path is no bag that can be read at all.
    """
    bag = open_bag(path)
    findings = [*_check_container(bag), *_check_topics(bag), *_check_twin(bag)]
    series: dict[str, Series] = {}
    aligned = None
    for topic, type_name in sorted(bag.topic_types().items()):
        if type_name != topics.TOPIC_TYPES.get(topic) or type_name not in NUMERIC_TYPES:
            continue
        decoder = TopicDecoder(topic, type_name, str(path))
        try:
            decode(bag, {topic: decoder})
            findings += _check_decoded(topic, decoder)
            frame, decoded = decoder.last_frame(), decoder.series()
            series |= decoded
            if topic == topics.ALIGNMENT:
                aligned = last_alignment(frame, decoded.get(topic))
        except StageError as error:
            findings.append(Finding(ERROR, topic, str(error)))
    for key, part in series.items():
        findings += _check_series(key, part)
    span = contents(bag)
    doubts = [*check_units(series), *check_times(series, (span.end - span.start) * 1e-9)]
    findings += [Finding(WARNING, about, text) for about, text in doubts]
    unit, frame = check_tracker(Session(str(path), series, alignment=aligned))
    findings += [Finding(ERROR, topics.TRACKER_POINT, unit)] if unit else []
    findings += [Finding(WARNING, topics.TRACKER_POINT, frame)] if frame else []
    return findings


def _check_container(bag: Bag) -> Iterator[Finding]:
    for warning in bag.warnings:
        yield Finding(WARNING, bag.path.name, warning)
    if bag.description.foreign:
        yield Finding(
            WARNING, bag.path.name, f'stored as {bag.description.storage}; a session is mcap: '
            'convert it with `rosbags-convert`'
        )  # fmt: skip
    elif bag.path.is_file():
        yield Finding(WARNING, bag.path.name, 'a bare file without metadata.yaml')
    for index in bag.files:
        for channel in index.channels.values():
            schema = index.schemas.get(channel.schema_id)
            if channel.message_encoding != 'cdr':
                yield Finding(
                    ERROR, channel.topic, f'encoded as {channel.message_encoding}, not CDR'
                )
            if schema is None or schema.encoding not in ('ros2msg', 'ros2idl') or not schema.data:
                yield Finding(ERROR, channel.topic, 'the message definition is not embedded')
            qos = parse_qos(channel.metadata.get('offered_qos_profiles'))
            latched = all(q.get('durability') in ('transient_local', 1) for q in qos)
            if channel.topic in topics.LATCHED and qos and not latched:
                yield Finding(
                    WARNING, channel.topic, 'is not latched: publish it transient local, depth 1'
                )
    for topic, missing in missing_messages(bag).items():
        if missing:
            yield Finding(WARNING, topic, f'{missing} messages were dropped while recording')


def _check_topics(bag: Bag) -> Iterator[Finding]:
    counts = contents(bag).counts
    if not sum(counts.values()):
        yield Finding(ERROR, bag.path.name, 'holds no message: record it again')
    for topic, type_name in sorted(bag.topic_types().items()):
        expected = topics.TOPIC_TYPES.get(topic)
        if expected is None:
            if topic.startswith(('/stage', '/tracker', '/contour', '/calibrator')):
                yield Finding(WARNING, topic, 'is no topic of a session and is not read')
        elif type_name != expected:
            yield Finding(ERROR, topic, f'is of type {type_name}, a session has {expected}')
        elif not counts.get(topic):
            yield Finding(OK, topic, 'no message, counts as absent')
    if not counts.get(topics.REFERENCE):
        yield Finding(
            ERROR, topics.REFERENCE, 'is absent: a session starts at its first message; record it'
        )
    for topic in (topics.COMMAND, topics.JOINT_STATES, topics.TRACKER_POINT):
        if not counts.get(topic):
            yield Finding(WARNING, topic, 'is absent: what needs it cannot be computed')


def _check_twin(bag: Bag) -> Iterator[Finding]:
    text = bag.description.custom_data.get(TWIN_KEY)
    if not text:
        yield Finding(OK, 'custom_data', 'carries no twin')
        return
    try:
        content = yaml_mapping(text, 'the text', 'record with a twin file')
        TwinFile.from_dict(content)
    except StageError as error:
        yield Finding(ERROR, 'custom_data', f'its twin is no twin file ({error})')
    else:
        yield Finding(OK, 'custom_data', f'carries a twin of kind {content.get("kind")}')


def _check_decoded(topic: str, decoder: TopicDecoder) -> Iterator[Finding]:
    """What is lost once the messages are sorted columns."""
    bad = decoder.not_a_number()
    if bad:
        yield Finding(ERROR, topic, f'holds a value that is not a finite number ({bad})')
    if decoder.unsorted():
        yield Finding(ERROR, topic, 'stamps go back in time: stamp with the time of measurement')
    for frame, child in decoder.frames():
        if topic == topics.TRACKER_POINT and frame != topics.TRACKER_FRAME:
            yield Finding(WARNING, topic, f'frame_id is {frame!r}, not {topics.TRACKER_FRAME!r}')
        if topic == topics.TEMPERATURE and not frame:
            yield Finding(WARNING, topic, 'frame_id does not name the sensor')
        if topic == topics.ALIGNMENT and (frame, child) != (
            topics.STAGE_FRAME,
            topics.TRACKER_FRAME,
        ):
            yield Finding(
                WARNING, topic, f'frame_id {frame!r} and child_frame_id {child!r} should be '
                f'{topics.STAGE_FRAME!r} and {topics.TRACKER_FRAME!r}'
            )  # fmt: skip


def _check_series(key: str, series: Series) -> Iterator[Finding]:
    topic = series.topic
    if topics.TOPIC_TYPES[topic] == JOINT_STATE:
        yield from _check_joints(series)
    if topic == topics.ALIGNMENT:
        norm = np.sqrt(sum(series.values[f'rotation.{axis}'] ** 2 for axis in 'xyzw'))
        if np.any(np.abs(norm - 1.0) > 1e-6):
            yield Finding(ERROR, key, 'the rotation is no unit quaternion: align again')
    yield from _check_stamps(key, series)


def _check_joints(series: Series) -> Iterator[Finding]:
    joints = list(dict.fromkeys(name.partition('.')[2] for name in series.values))
    unknown = [joint for joint in joints if joint not in AXES]
    if not joints:
        yield Finding(ERROR, series.topic, 'names no joint: the joints are x and y')
    elif unknown:
        yield Finding(ERROR, series.topic, f'names joint {unknown[0]!r}: the joints are x and y')
    elif joints != [axis for axis in AXES if axis in joints]:
        yield Finding(WARNING, series.topic, 'the joints are not in the order [x, y]')
    if series.topic == topics.COMMAND and not any(
        name.startswith(('velocity.', 'effort.')) for name in series.values
    ):
        yield Finding(ERROR, series.topic, 'holds neither velocity nor effort')
    for quantity in _QUANTITIES.get(series.topic, ()):
        for axis in joints:
            column = series.values.get(f'{quantity}.{axis}')
            if column is None or np.isnan(column).all():
                yield Finding(ERROR, series.topic, f'holds no {quantity} of {axis}')
            elif np.isnan(column).any():
                count = int(np.isnan(column).sum())
                yield Finding(
                    ERROR, series.topic, f'{count} messages lack the {quantity} of {axis}'
                )


def _check_stamps(key: str, series: Series) -> Iterator[Finding]:
    stamps: NDArray[np.int64] = series.stamps
    if np.any(stamps <= 0):
        yield Finding(ERROR, key, f'{int(np.sum(stamps <= 0))} messages carry no stamp')
    steps = np.diff(stamps)
    if len(steps) == 0:
        yield Finding(OK, key, f'{len(stamps)} message')
        return
    repeated = int(np.sum(steps == 0))
    if repeated:
        yield Finding(WARNING, key, f'{repeated} messages repeat the stamp of the one before')
    period = float(np.median(steps)) * 1e-9
    yield Finding(OK, key, _pace(stamps, period))
    gaps = np.flatnonzero(steps * 1e-9 > _GAP * period) if period > 0 else np.array([], int)
    # Set-points come when somebody wants a motion.
    streamed = topics.TOPIC_TYPES[series.topic] == JOINT_STATE and series.topic != topics.SETPOINT
    if len(gaps) and streamed:
        longest = steps[gaps].max() * 1e-9
        yield Finding(WARNING, key, f'{len(gaps)} gaps, the longest of {longest:.3f} s')


def _pace(stamps: NDArray[np.int64], period: float) -> str:
    """How many messages there are a second: on the whole, usually, and where there are fewest.

    `stamps` (n,) [ns], `period` [s] is the median of their steps.
    """
    span = (stamps[-1] - stamps[0]) * 1e-9
    text = f'{len(stamps)} messages in {span:.3f} s'
    if period <= 0.0:
        return f'{text}, most of one moment'
    text += f', mean {(len(stamps) - 1) / span:.6g} Hz, usual step {1.0 / period:.6g} Hz'
    stretch = max(1.0, _STRETCH * period)
    begins = stamps[stamps <= stamps[-1] - round(stretch * 1e9)]
    if not len(begins):
        return text
    counts = np.searchsorted(stamps, begins + round(stretch * 1e9)) - np.arange(len(begins))
    slowest = int(np.argmin(counts))
    begin = (begins[slowest] - stamps[0]) * 1e-9
    return (
        f'{text}; slowest stretch {counts[slowest] / stretch:.4g} Hz for {stretch:.3g} s '
        f'from {begin:.1f} s on'
    )


@command_line
def main(arguments: Sequence[str] | None = None) -> int:
    """Print the findings; exit 0 where the bag is a session bag, else 1."""
    parser = argparse.ArgumentParser(
        prog='check',
        description='Check whether a bag is a session bag as interfaces.md describes it.',
    )
    parser.add_argument('bag', help='directory of a bag, or an mcap file')
    parser.add_argument('-q', '--quiet', action='store_true', help='print only what is wrong')
    parsed = parser.parse_args(arguments)
    findings = check_bag(parsed.bag)
    for finding in findings:
        if finding.level != OK or not parsed.quiet:
            print(finding)
    errors = sum(finding.level == ERROR for finding in findings)
    warnings = sum(finding.level == WARNING for finding in findings)
    verdict = 'is no session bag' if errors else 'is a session bag'
    print(f'{parsed.bag} {verdict}: {errors} errors, {warnings} warnings')
    return 1 if errors else 0
