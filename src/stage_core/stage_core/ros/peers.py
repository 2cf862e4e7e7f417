"""Which nodes a node hears from: which have fallen silent, and which speak twice.

Every node speaks on /diagnostics once a second of wall time, also when virtual time stands still.
That makes it the heartbeat: topics are silent for good reasons, and discovery forgets a process
that was killed only after its lease has run out. For the same reason a second graph on the domain
is known by its heartbeats: two processes that speak by turns under one node's name.
"""

from __future__ import annotations

import os
import socket
import struct
import time
from collections.abc import Callable, Sequence
from typing import Any

#: Without a word for this long a node counts as gone [s]: several heartbeats.
SILENCE = 4.0

#: Node -> the nodes whose work it uses, and at least one watcher for every node. The plant and
#: the tracker are missed on their wires, by the driver and the bridge.
PEERS: dict[str, tuple[str, ...]] = {
    'tracker_bridge': ('stage_driver',),
    'calibrator': ('stage_driver', 'tracker_bridge'),
    'contour_ctrl': ('stage_driver', 'calibrator'),
    'gap_diagnosis': ('stage_driver', 'tracker_bridge', 'session_recorder'),
    'session_recorder': (
        'stage_driver',
        'tracker_bridge',
        'calibrator',
        'contour_ctrl',
        'gap_diagnosis',
    ),
}


#: Where a DiagnosticArray's CDR holds the length of its frame_id, behind header and stamp.
_FRAME = 12
_LENGTH = struct.Struct('<I')


def process_name() -> str:
    """This process for a person, on any computer: the frame_id of its DiagnosticArrays."""
    return f'pid {os.getpid()} on {socket.gethostname()}'


def speaker(data: bytes) -> tuple[str, str] | None:
    """Node and process of a DiagnosticArray's CDR bytes; None where its first status has no name.

    A message of twenty values takes rclpy as long as a tick; its first name is enough.
    """
    try:
        process, place = _text(data, _FRAME)
        (count,) = _LENGTH.unpack_from(data, place)
        if data[:2] != b'\x00\x01' or not count:
            return None
        # The level is one byte; lengths are aligned to four behind the encapsulation.
        name, _ = _text(data, place + 8)
    except (struct.error, UnicodeDecodeError):
        return None
    node, colon, _ = name.partition(':')
    return (node, process) if colon else None


def _text(data: bytes, place: int) -> tuple[str, int]:
    """A string and the aligned place behind it."""
    (length,) = _LENGTH.unpack_from(data, place)
    begin = place + 4
    end = begin + length
    return data[begin : max(begin, end - 1)].decode(), end + -end % 4


class PeerWatch:
    """When each peer was heard last, and who speaks under a name that another process has.

    Parameters
    ----------
    peers
        Nodes that are missed when they fall silent.
    doubled
        Whether the graph has two publishers of /diagnostics in a node's name: a replayed bag
        speaks with the voices of its nodes, from a publisher of its own.
    """

    def __init__(
        self,
        peers: Sequence[str],
        doubled: Callable[[str], bool] = lambda _: True,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._clock = clock
        self._doubled = doubled
        self._heard: dict[str, float | None] = dict.fromkeys(peers)
        #: Node -> its processes, and when each was heard last.
        self._voices: dict[str, dict[str, float]] = {}
        self._newest: dict[str, str] = {}
        #: Node -> the processes that speak by turns, and when they were found to.
        self._rivals: dict[str, tuple[float, list[str]]] = {}

    def hear(self, node: str, process: str = '') -> str:
        """Note that a process spoke as a node; the sentence about a rival that was not known."""
        now = self._clock()
        if node in self._heard:
            self._heard[node] = now
        voices = {p: t for p, t in self._voices.get(node, {}).items() if now - t < SILENCE}
        # A node that was started again is not followed by its former self.
        by_turns = process in voices and self._newest[node] != process
        voices[process], self._newest[node], self._voices[node] = now, process, voices
        if not (by_turns and self._doubled(node)):
            return ''
        known = node in self._rivals
        self._rivals[node] = now, sorted(voices)
        return '' if known else self._quarrel(node)

    def _quarrel(self, node: str) -> str:
        processes = ' and '.join(self._rivals[node][1])
        domain = os.environ.get('ROS_DOMAIN_ID', '0')
        return (
            f'two {node} speak on ROS_DOMAIN_ID {domain}, {processes}: end one graph, or give it '
            'another ROS_DOMAIN_ID'
        )

    def silent(self) -> list[str]:
        """Peers that were heard before and have said nothing for `SILENCE`."""
        now = self._clock()
        return [
            peer
            for peer, heard in self._heard.items()
            if heard is not None and now - heard > SILENCE
        ]

    def status(self) -> tuple[bool, str, dict[str, Any]]:
        """Whether nobody is missed or doubled, a sentence, the age of each peer's last word."""
        now = self._clock()
        values = {
            peer: 'not heard yet' if heard is None else f'heard {now - heard:.0f} s ago'
            for peer, heard in self._heard.items()
        }
        self._rivals = {n: r for n, r in self._rivals.items() if now - r[0] < SILENCE}
        if self._rivals:
            return False, '; '.join(map(self._quarrel, self._rivals)), values
        silent = self.silent()
        if silent:
            return False, f'{", ".join(silent)} fell silent: start it again', values
        return True, 'nobody fell silent', values
