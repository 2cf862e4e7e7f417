"""Text from outside, from a file, a topic or a parameter, as plain Python values.

Whatever is wrong with the text is one `StageError` that names it and the remedy: a parser itself
raises what its depths raise, from a bad date to the end of the interpreter's stack.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import yaml

from stage_core.errors import StageError

#: Deepest nesting of YAML: libyaml's composer recurses in C, and the process would end there.
DEEPEST = 100

#: By libyaml where PyYAML has it: seven times faster.
_LOADER: Any = getattr(yaml, 'CSafeLoader', yaml.SafeLoader)
#: `!!int ""`, `!!timestamp x`, `!!bool x`, 2020-13-45, 5000 digits and 5000 brackets, in turn.
_FAILURES = (yaml.YAMLError, LookupError, AttributeError, TypeError, ValueError, RecursionError)


def file_text(path: str | Path, what: str, remedy: str) -> str:
    """The content of a UTF-8 file.

    Raises
    ------
    StageError
        If it cannot be read.
    """
    try:
        return Path(path).read_text(encoding='utf-8')
    except (OSError, ValueError) as error:
        reason = getattr(error, 'strerror', None) or str(error)
        raise StageError(f'cannot read {what} ({_line(reason)}): {remedy}') from error


def yaml_value(text: str, what: str, remedy: str) -> Any:
    """Value of a YAML text.

    Raises
    ------
    StageError
        If it is not valid YAML of plain values, or nested deeper than `DEEPEST`.
    """
    try:
        depth = 0
        for event in yaml.parse(text, Loader=_LOADER):
            depth += isinstance(event, yaml.CollectionStartEvent)
            depth -= isinstance(event, yaml.CollectionEndEvent)
            if depth > DEEPEST:
                raise ValueError(f'nested deeper than {DEEPEST} levels')
        return yaml.load(text, Loader=_LOADER)
    except _FAILURES as error:
        mark = getattr(error, 'problem_mark', None)
        where = f'line {mark.line + 1}: {getattr(error, "problem", "")}' if mark else error
        raise StageError(f'{what} is not valid YAML ({_line(where)}): {remedy}') from error


def yaml_mapping(text: str, what: str, remedy: str) -> dict[Any, Any]:
    """Mapping of a YAML text; errors as of `yaml_value`, and where it holds no mapping."""
    content = yaml_value(text, what, remedy)
    if not isinstance(content, dict):
        raise StageError(f'{what} holds no YAML mapping: {remedy}')
    return content


def json_object(text: str, what: str, remedy: str) -> dict[str, Any]:
    """Object of a JSON text.

    Raises
    ------
    StageError
        If it is not valid JSON, or no object.
    """
    try:
        content = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise StageError(f'{what} is not valid JSON ({_line(error)}): {remedy}') from error
    if not isinstance(content, dict):
        raise StageError(f'{what} holds no JSON object: {remedy}')
    return content


def _line(reason: object) -> str:
    return ' '.join(str(reason).split())[:120]
