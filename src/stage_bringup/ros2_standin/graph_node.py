"""A short-lived node that looks at the graph."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from stage_core.errors import StageError
from stage_core.ros.client_node import GraphClient

#: Discovery has settled when nothing new was seen for this long [s] ...
_QUIET = 0.5
#: ... and where nobody was seen yet for this long: the first one answers within 0.3 s.
_ALONE = 1.5
#: A graph that changes all the time is taken as it is after this time [s].
_LONGEST = 3.0
#: Longest wait for something that is named [s]; found within one where the machine is quiet.
_NAMED = 10.0


class Looker(GraphClient):
    """A hidden node with what the verbs ask of the graph."""

    def __init__(self) -> None:
        super().__init__(f'_ros2cli_{os.getpid()}')

    def settle(self) -> None:
        """Wait until discovery has settled."""
        last: Any = None
        changed = time.monotonic()

        def quiet() -> bool:
            nonlocal last, changed
            seen = (
                sorted(self.node.get_node_names_and_namespaces()),
                sorted(self.node.get_topic_names_and_types()),
                sorted(self.node.get_service_names_and_types()),
            )
            if seen != last:
                last, changed = seen, time.monotonic()
            return time.monotonic() - changed >= (_ALONE if len(seen[0]) < 2 else _QUIET)

        with suppress(StageError):
            self.wait_for(quiet, _LONGEST, 'a quiet graph')

    def require(self, found: Callable[[], Any], absent: str, timeout: float = _NAMED) -> Any:
        """The first true value of ``found()``; StageError with the text `absent` after a while."""
        try:
            self.wait_for(lambda: bool(found()), timeout, absent)
        except StageError:
            raise StageError(absent) from None
        return found()

    def topic_type(self, topic: str) -> str:
        """Type of a topic as soon as somebody publishes it."""
        return str(
            self.require(
                lambda: (
                    self.node.get_publishers_info_by_topic(topic)
                    and dict(self.node.get_topic_names_and_types()).get(topic)
                ),
                f'Could not determine the type for the passed topic: {topic} is not published',
            )[0]
        )

    def nodes(self) -> list[str]:
        """Full names of the nodes that are not hidden, sorted."""
        names = self.node.get_node_names_and_namespaces()
        return sorted(
            f'{namespace.rstrip("/")}/{name}' for name, namespace in names if name[0] != '_'
        )

    def named_node(self, name: str) -> str:
        """Full name of a node that is on the graph; StageError if it does not appear."""
        wanted = full_name(name)
        self.require(lambda: wanted in self.nodes(), 'Node not found')
        return wanted

    def listening_qos(self, topic: str) -> Any:
        """Quality of service that matches every publisher of a topic."""
        from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

        profiles = [p.qos_profile for p in self.node.get_publishers_info_by_topic(topic)]
        reliable = all(p.reliability == ReliabilityPolicy.RELIABLE for p in profiles)
        latched = all(p.durability == DurabilityPolicy.TRANSIENT_LOCAL for p in profiles)
        return QoSProfile(
            depth=1000,
            reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
            durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
        )


def print_names(names_and_types: Callable[[Any], Any], show_types: bool) -> None:
    """Print what a settled graph holds, without hidden names."""
    with Looker() as looker:
        looker.settle()
        found = sorted(names_and_types(looker.node))
    for name, types in found:
        if '/_' not in name:
            print(f'{name} [{", ".join(types)}]' if show_types else name)


def full_name(name: str) -> str:
    """A name with its leading slash."""
    return name if name.startswith('/') else '/' + name
