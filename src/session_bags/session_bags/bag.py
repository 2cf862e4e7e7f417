"""Opening a bag of any of the usual forms."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path

from session_bags import metadata
from session_bags.records import FileIndex, read_index
from stage_core.errors import StageError


@dataclass
class Bag:
    """A bag: its description and the indexes of its mcap files.

    `files` is empty where rosbags must read the storage (sqlite3, compressed files).
    """

    path: Path
    description: metadata.BagMetadata
    files: list[FileIndex] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)

    def topic_types(self) -> dict[str, str]:
        """Topic -> message type."""
        types = {topic.name: topic.type_name for topic in self.description.topics}
        for index in self.files:
            for channel in index.channels.values():
                schema = index.schemas.get(channel.schema_id)
                types[channel.topic] = schema.name if schema else ''
        return types


def open_bag(path: str | Path) -> Bag:
    """Open a rosbag2 directory (mcap or sqlite3, finished or not) or a bare mcap file.

    Raises
    ------
    StageError
        If there is no bag at the path or it cannot be read.
    """
    path = Path(path)
    if path.is_file() and path.suffix == '.mcap':
        bag = Bag(path, metadata.BagMetadata(), [read_index(path)])
    elif path.is_dir():
        bag = _open_directory(path)
    else:
        what = 'is not a bag' if path.exists() else 'does not exist'
        raise StageError(f'{path} {what}: name the directory of a session bag or an mcap file')
    for index in bag.files:
        if not bag.description.custom_data:
            bag.description.custom_data = metadata.inner_custom_data(index.metadata)
        if index.cut:
            bag.warnings.append(
                f'{index.path.name} is unfinished and was read up to its last complete chunk; '
                'make it whole with `ros2 run session_bags repair`'
            )
        elif not index.finished:
            bag.warnings.append(
                f'{index.path.name} has no complete index and was read from end to end; '
                '`ros2 run session_bags repair` gives it one'
            )
    return bag


def _open_directory(path: Path) -> Bag:
    try:
        description = metadata.load(path)
        lost = None
    except StageError as error:
        description, lost = None, error
    found = mcap_files(path)
    if description is None:
        if not found:
            raise lost or StageError(
                f'{path} holds no bag (no metadata.yaml, no mcap file): name the directory of a '
                'session bag'
            )
        bag = Bag(path, metadata.BagMetadata(), [read_index(file) for file in found])
        bag.warnings.append('metadata.yaml is missing or unreadable; the mcap files were read')
        return bag
    if description.foreign:
        return Bag(path, description)
    names = [path / record.path for record in description.files] or found
    missing = [file for file in names if not file.is_file()]
    if missing or not names:
        raise StageError(
            f'{path} lacks its file {missing[0].name if missing else "*.mcap"}: copy the whole '
            'directory of the bag'
        )
    return Bag(path, description, [read_index(file) for file in names])


def mcap_files(directory: Path) -> list[Path]:
    """Files of a bag in the order in which they were recorded."""
    return sorted(directory.glob('*.mcap'), key=_natural)


def _natural(path: Path) -> list[tuple[int, str]]:
    """Sorting key that puts ``run_10`` after ``run_9``."""
    return [(int(part) if part.isdigit() else -1, part) for part in re.split(r'(\d+)', path.name)]
