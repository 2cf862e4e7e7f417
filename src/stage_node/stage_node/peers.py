"""Which nodes a node hears from, and which of them have fallen silent.

Every node speaks on /diagnostics once a second of wall time, also when virtual time stands still.
That makes it the heartbeat: topics are silent for good reasons, and discovery forgets a process
that was killed only after its lease has run out.
"""

from __future__ import annotations

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


class PeerWatch:
    """When each peer was heard last, from the names of statuses on /diagnostics."""

    def __init__(self, peers: Sequence[str], clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._heard: dict[str, float | None] = dict.fromkeys(peers)

    def hear(self, status_names: Sequence[str]) -> None:
        """Note the nodes that speak: a status is named ``node: task``."""
        now = self._clock()
        for name in status_names:
            node = name.partition(':')[0]
            if node in self._heard:
                self._heard[node] = now

    def silent(self) -> list[str]:
        """Peers that were heard before and have said nothing for `SILENCE`."""
        now = self._clock()
        return [
            peer
            for peer, heard in self._heard.items()
            if heard is not None and now - heard > SILENCE
        ]

    def status(self) -> tuple[bool, str, dict[str, Any]]:
        """Whether nobody fell silent, a sentence, and the age of each peer's last word."""
        now = self._clock()
        values = {
            peer: 'not heard yet' if heard is None else f'heard {now - heard:.0f} s ago'
            for peer, heard in self._heard.items()
        }
        silent = self.silent()
        if silent:
            return False, f'{", ".join(silent)} fell silent: start it again', values
        return True, 'nobody fell silent', values
