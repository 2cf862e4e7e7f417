"""The parameter files of the workspace, read as the nodes read them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import yaml

CONFIG = Path(__file__).resolve().parents[1] / 'ros_ws' / 'config'


def section(name: str) -> tuple[str, dict[str, Any]]:
    """The node of a file, by the file's stem, and its parameters by their names with dots."""
    content = yaml.safe_load((CONFIG / f'{name}.yaml').read_text(encoding='utf-8'))
    [(node, inside)] = content.items()
    return node, dict(_flat(inside['ros__parameters']))


def _flat(content: Mapping[str, Any], prefix: str = '') -> Iterator[tuple[str, Any]]:
    for name, value in content.items():
        if isinstance(value, dict):
            yield from _flat(value, f'{prefix}{name}.')
        else:
            yield prefix + name, value
