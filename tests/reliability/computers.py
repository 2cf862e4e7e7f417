"""Two network namespaces as two computers, joined by a cable that delays, loses and is cut."""

from __future__ import annotations

import fcntl
import heapq
import itertools
import multiprocessing
import os
import random
import select
import struct
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from stage_bringup.processes import NodeCommand

#: ioctl and flags of Linux' tun.h: an Ethernet device whose frames a process reads and writes.
TUNSETIFF, IFF_TAP, IFF_NO_PI = 0x400454CA, 0x0002, 0x1000
#: Names are unique on the machine, so that two test runs do not meet.
PREFIX = f'stage{os.getpid() % 100_000}'
NAMES = f'{PREFIX}a', f'{PREFIX}b'


@dataclass(frozen=True)
class On(NodeCommand):
    """A node on one of the computers."""

    computer: str = ''

    def arguments(self) -> list[str]:
        """Command line of the process."""
        return ['ip', 'netns', 'exec', self.computer, *super().arguments()]


def ip(*words: str) -> None:
    """Run `ip`; raises CalledProcessError."""
    subprocess.run(['ip', *words], check=True, capture_output=True)


def _computer(name: str, address: str) -> int:
    """A namespace with one Ethernet device; the descriptor of the device's other end."""
    device = os.open('/dev/net/tun', os.O_RDWR)
    tap = f'{name}0'
    fcntl.ioctl(device, TUNSETIFF, struct.pack('16sH', tap.encode(), IFF_TAP | IFF_NO_PI))
    ip('netns', 'add', name)
    ip('link', 'set', tap, 'netns', name)
    ip('-n', name, 'address', 'add', f'{address}/24', 'dev', tap)
    for interface in ('lo', tap):
        ip('-n', name, 'link', 'set', interface, 'up')
    ip('-n', name, 'route', 'add', 'default', 'dev', tap)
    return device


def _carry(ends: tuple[int, int], delay: float, loss: float, whole: Any) -> None:
    """Carry each frame from one end to the other after `delay` [s], unless it is lost."""
    generator, order = random.Random(1), itertools.count()
    waiting: list[tuple[float, int, int, bytes]] = []
    while True:
        patience = max(0.0, waiting[0][0] - time.monotonic()) if waiting else 0.5
        for end in select.select(ends, [], [], patience)[0]:
            frame = os.read(end, 65_536)
            if whole.value and generator.random() >= loss:
                other = ends[1] if end == ends[0] else ends[0]
                heapq.heappush(waiting, (time.monotonic() + delay, next(order), other, frame))
        while waiting and waiting[0][0] <= time.monotonic():
            os.write(waiting[0][2], heapq.heappop(waiting)[3])


@contextmanager
def two_computers(delay: float, loss: float) -> Iterator[Any]:
    """Computers `NAMES` and their cable; its `value` is 1 while it is whole.

    Raises
    ------
    OSError, subprocess.CalledProcessError
        Namespaces or Ethernet devices are not permitted here.
    """
    ends: list[int] = []
    whole = multiprocessing.get_context('fork').Value('b', 1)
    cable = None
    try:
        for number, name in enumerate(NAMES, 1):
            ends.append(_computer(name, f'10.77.0.{number}'))
        cable = multiprocessing.get_context('fork').Process(
            target=_carry, args=((ends[0], ends[1]), delay, loss, whole), daemon=True
        )
        cable.start()
        yield whole
    finally:
        if cable is not None:
            cable.kill()
            cable.join()
        for end in ends:
            os.close(end)
        for name in NAMES[: len(ends)]:
            subprocess.run(['ip', 'netns', 'delete', name], capture_output=True, check=False)
