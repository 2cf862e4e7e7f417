"""``metadata.yaml`` of a rosbag2 directory, version 9."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from stage_core.errors import StageError
from stage_core.untrusted import file_text, yaml_mapping, yaml_value
from stage_core.whole_file import write_whole

VERSION = 9
FILE_NAME = 'metadata.yaml'
_OUTER_KEY = 'rosbag2_bagfile_information'
#: What a mapping raises that lacks a part, or holds another type there.
_INCOMPLETE = (KeyError, TypeError, ValueError, AttributeError)


@dataclass
class TopicRecord:
    """One topic of a bag; hash and quality of service are for writing and not read back."""

    name: str
    type_name: str
    type_hash: str = ''
    qos: list[dict[str, Any]] = field(default_factory=list)
    count: int = 0


@dataclass
class FileRecord:
    """One storage file of a bag; times of arrival [ns]."""

    path: str
    start: int = 0
    end: int = 0
    count: int = 0


@dataclass
class BagMetadata:
    """What ``metadata.yaml`` says."""

    storage: str = 'mcap'
    compression_mode: str = ''
    files: list[FileRecord] = field(default_factory=list)
    topics: list[TopicRecord] = field(default_factory=list)
    custom_data: dict[str, str] = field(default_factory=dict)

    @property
    def foreign(self) -> bool:
        """Whether the files are no plain mcap files: another storage, or compressed."""
        return self.storage != 'mcap' or self.compression_mode in ('file', 'message')

    def content(self) -> dict[str, Any]:
        """The inner mapping with every key that rosbag2 reads unconditionally."""
        filled = [f for f in self.files if f.count]
        start = min((f.start for f in filled), default=0)
        end = max((f.end for f in filled), default=0)
        return {
            'version': VERSION,
            'storage_identifier': self.storage,
            'duration': {'nanoseconds': end - start},
            'starting_time': {'nanoseconds_since_epoch': start},
            'message_count': sum(f.count for f in self.files),
            'topics_with_message_count': [
                {
                    'topic_metadata': {
                        'name': topic.name,
                        'type': topic.type_name,
                        'serialization_format': 'cdr',
                        'offered_qos_profiles': topic.qos,
                        'type_description_hash': topic.type_hash,
                    },
                    'message_count': topic.count,
                }
                for topic in self.topics
            ],
            'compression_format': '',
            'compression_mode': self.compression_mode,
            'relative_file_paths': [f.path for f in self.files],
            'files': [
                {
                    'path': f.path,
                    'starting_time': {'nanoseconds_since_epoch': f.start},
                    'duration': {'nanoseconds': f.end - f.start},
                    'message_count': f.count,
                }
                for f in self.files
            ],
            'custom_data': self.custom_data or None,
            'ros_distro': 'jazzy',
        }

    def save(self, directory: Path) -> None:
        """Write ``metadata.yaml``; a reader sees the old file or the new one, never a part."""
        write_whole(directory / FILE_NAME, dump({_OUTER_KEY: self.content()}))


class _Dumper(yaml.SafeDumper):
    """Writes every value out: rosbag2's parser knows no YAML anchors."""

    def ignore_aliases(self, data: Any) -> bool:
        return True


def dump(content: Any) -> str:
    """YAML in block style with the order of keys kept."""
    return yaml.dump(content, Dumper=_Dumper, sort_keys=False, default_flow_style=False)


def load(directory: Path) -> BagMetadata | None:
    """Read ``metadata.yaml`` of any version; None where there is none.

    Raises
    ------
    StageError
        If the file is not the YAML of a bag.
    """
    path = directory / FILE_NAME
    if not path.is_file():
        return None
    remedy = f'run `ros2 run session_bags repair {directory}` to write it anew'
    content = yaml_mapping(file_text(path, str(path), remedy), str(path), remedy)
    try:
        return _parse(content[_OUTER_KEY])
    except _INCOMPLETE as error:
        raise StageError(f'{path} is not the description of a bag: {remedy}') from error


def inner_custom_data(records: Mapping[str, Mapping[str, str]]) -> dict[str, str]:
    """Custom data of the ``rosbag2`` record of an mcap file; none where it cannot be read."""
    text = records.get('rosbag2', {}).get('serialized_metadata', '')
    try:
        return _parse(yaml_mapping(text, 'the rosbag2 record', 'it is ignored')).custom_data
    except (*_INCOMPLETE, StageError):
        return {}


def _parse(inner: Mapping[str, Any]) -> BagMetadata:
    files: Sequence[Mapping[str, Any]] = inner.get('files') or ()
    by_path = {str(f['path']): f for f in files}
    records = []
    for path in inner.get('relative_file_paths') or ():
        entry = by_path.get(str(path))
        if entry is None:
            records.append(FileRecord(str(path)))
            continue
        start = int(entry['starting_time']['nanoseconds_since_epoch'])
        end = start + int(entry['duration']['nanoseconds'])
        records.append(FileRecord(str(path), start, end, int(entry['message_count'])))
    topics = []
    for entry in inner.get('topics_with_message_count') or ():
        topic = entry['topic_metadata']
        topics.append(
            TopicRecord(str(topic['name']), str(topic['type']), count=int(entry['message_count']))
        )
    custom = inner.get('custom_data') or {}
    return BagMetadata(
        storage=str(inner['storage_identifier']),
        compression_mode=str(inner.get('compression_mode') or '').lower(),
        files=records,
        topics=topics,
        custom_data={
            str(k): v if isinstance(v, str) else yaml.safe_dump(v) for k, v in dict(custom).items()
        },
    )


def parse_qos(profiles: Any) -> list[dict[str, Any]]:
    """Quality of service as a list of mappings; versions before 9 hold it as YAML text."""
    if isinstance(profiles, str):
        try:
            profiles = yaml_value(profiles, 'the quality of service', 'it is ignored')
        except StageError:
            return []
    return [dict(p) for p in profiles or () if isinstance(p, Mapping)]
