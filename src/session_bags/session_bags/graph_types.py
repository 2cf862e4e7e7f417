"""Message classes and quality of service of the topics on the graph."""

from __future__ import annotations

import importlib
from functools import cache
from typing import Any

from stage_core.errors import StageError


@cache
def message_class(type_name: str) -> Any:
    """Class of a message type in ROS 2 spelling, as ``sensor_msgs/msg/JointState``.

    Raises
    ------
    StageError
        If the type is not installed.
    """
    try:
        package, kind, name = type_name.split('/')
        return getattr(importlib.import_module(f'{package}.{kind}'), name)
    except (ValueError, ImportError, AttributeError) as error:
        raise StageError(
            f'the message type {type_name} is not installed: install or source its package'
        ) from error


def has_header(type_name: str) -> bool:
    """Whether the type begins with a ``std_msgs/Header``, whose stamp its CDR begins with."""
    fields = message_class(type_name).get_fields_and_field_types()
    return next(iter(fields.values()), '') == 'std_msgs/Header'
