"""Messages from YAML and to YAML, and their classes by name."""

from __future__ import annotations

import array
import re
from collections.abc import Mapping
from typing import Any

import numpy as np
import yaml

from session_bags.graph_types import message_class
from stage_core.errors import StageError
from stage_core.untrusted import yaml_value


def interface(name: str, kind: str) -> Any:
    """Class of ``pkg/msg/Type`` or ``pkg/srv/Type``; the middle part may be left out.

    Raises
    ------
    StageError
        If it is not installed.
    """
    parts = name.split('/')
    if len(parts) == 2:
        parts.insert(1, kind)
    try:
        return message_class('/'.join(parts))
    except StageError as error:
        raise StageError(
            f"The passed {kind} type '{name}' is invalid: name an installed one"
        ) from error


def fill(message: Any, text: str) -> Any:
    """Fill a message from YAML, as ``"{data: true}"``.

    Raises
    ------
    StageError
        If the text is no YAML mapping, or names a field or value that does not fit.
    """
    values = yaml_value(text, f'the text {text!r}', "write a mapping, as '{data: true}'")
    if not isinstance(values, Mapping):
        raise StageError(f'the passed value needs to be a dictionary in YAML format, got {text!r}')
    _set_fields(message, values)
    return message


def _set_fields(message: Any, values: Mapping[str, Any]) -> None:
    types = message.get_fields_and_field_types()
    # Unchecked, a value of the wrong type ends the process when the message is sent.
    message._check_fields = True
    for name, value in values.items():
        if name not in types:
            known = ', '.join(types) or 'none'
            raise StageError(f'{type(message).__name__} has no field {name}: it has {known}')
        current = getattr(message, name)
        try:
            if hasattr(current, 'get_fields_and_field_types'):
                _set_fields(current, value or {})
            else:
                setattr(message, name, _numbers(value, types[name]))
        except (AssertionError, TypeError, ValueError, AttributeError) as error:
            raise StageError(f'{name} is a {types[name]}, got {value!r}') from error


def _numbers(value: Any, type_name: str) -> Any:
    """A value with its whole numbers as floats where the field holds such."""
    if re.search(r'\b(float|double)\b', type_name) is None:
        return value
    if isinstance(value, list):
        return [_numbers(entry, type_name) for entry in value]
    return float(value) if type(value) is int else value


def to_plain(message: Any) -> Any:
    """A message as plain mappings, lists and numbers."""
    if hasattr(message, 'get_fields_and_field_types'):
        return {
            name: to_plain(getattr(message, name)) for name in message.get_fields_and_field_types()
        }
    if isinstance(message, (list, tuple, array.array)):
        return [to_plain(item) for item in message]
    if isinstance(message, np.ndarray):
        return message.tolist()
    if isinstance(message, bytes):
        return message[0] if len(message) == 1 else list(message)
    return message


def to_yaml(message: Any) -> str:
    """A message as ``ros2 topic echo`` prints it."""
    return yaml.safe_dump(to_plain(message), sort_keys=False, default_flow_style=False, width=1e9)
