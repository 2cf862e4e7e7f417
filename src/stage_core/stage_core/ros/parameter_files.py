"""Parameter files of the command line, checked before ROS reads them: one line for each mistake.

ROS itself writes two lines for a file that it cannot read, and nothing at all for a section of a
name that no node has.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterator, Sequence
from typing import Any

from stage_core.errors import StageError
from stage_core.untrusted import file_text, yaml_mapping

_PARAMETERS = 'ros__parameters'
_REMEDY = 'name a file as those in ros_ws/config'


def check_files(arguments: Sequence[str]) -> None:
    """Read every parameter file of a command line.

    Raises
    ------
    StageError
        If one cannot be read or is no parameter file; the message names it.
    """
    for path in _paths(arguments):
        list(_sections(path))


def refuse_misspelt(arguments: Sequence[str], node: str) -> None:
    """Refuse a file that has a section of nearly this name, and none of this name.

    Raises
    ------
    StageError
        With both names.
    """
    for path in _paths(arguments):
        names = [name.rpartition('/')[2] for name in _sections(path)]
        if node in names or any('*' in name for name in names):
            continue
        if close := difflib.get_close_matches(node, names, n=1, cutoff=0.8):
            raise StageError(
                f'parameter file {path} has a section {close[0]} and none for {node}: '
                'correct the name'
            )


def _paths(arguments: Sequence[str]) -> list[str]:
    return [
        path
        for option, path in zip(arguments, arguments[1:], strict=False)
        if option == '--params-file'
    ]


def _sections(path: str) -> Iterator[str]:
    """Names of the nodes that a file has parameters for, with their namespaces."""
    what = f'parameter file {path}'
    yield from _walk(yaml_mapping(file_text(path, what, _REMEDY), what, _REMEDY), '', what)


def _walk(content: Any, name: str, what: str) -> Iterator[str]:
    if not isinstance(content, dict):
        raise StageError(f'{what}: {name} holds no {_PARAMETERS}: {_REMEDY}')
    if _PARAMETERS in content:
        yield name
        return
    for key, value in content.items():
        yield from _walk(value, f'{name}/{key}' if name else str(key), what)
