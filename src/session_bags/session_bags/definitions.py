"""Message definitions, type hashes and quality of service as a bag stores them."""

from __future__ import annotations

from functools import cache, lru_cache
from typing import Any

from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from stage_core.errors import StageError

#: What rosbag2 writes for a duration that was not set.
_INFINITE = {'sec': 9223372036, 'nsec': 854775807}


@lru_cache(maxsize=1)
def typestore() -> Typestore:
    """Types of ROS 2 Jazzy's common interfaces."""
    return get_typestore(Stores.ROS2_JAZZY)


@cache
def definition(type_name: str) -> tuple[str, str]:
    """Concatenated message definition (``ros2msg``) and RIHS01 hash of a type.

    Raises
    ------
    StageError
        For a type that is not part of common_interfaces.
    """
    try:
        text, _ = typestore().generate_msgdef(type_name, ros_version=2)
        return text, typestore().hash_rihs01(type_name)
    except Exception as error:
        raise StageError(
            f'the message type {type_name} is unknown: record topics of common_interfaces only'
        ) from error


def quality_of_service(latched: bool = False) -> dict[str, Any]:
    """Offered quality of service in the words of rosbag2's metadata version 9."""
    return {
        'history': 'keep_last',
        'depth': 1 if latched else 1000,
        'reliability': 'reliable',
        'durability': 'transient_local' if latched else 'volatile',
        'deadline': dict(_INFINITE),
        'lifespan': dict(_INFINITE),
        'liveliness': 'automatic',
        'liveliness_lease_duration': dict(_INFINITE),
        'avoid_ros_namespace_conventions': False,
    }
