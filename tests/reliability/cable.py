"""The cable of `computers.py`: `cable.py FD FD DELAY LOSS`, cut and joined by its input."""

from __future__ import annotations

import heapq
import itertools
import os
import random
import select
import sys
import time


def carry(ends: tuple[int, int], delay: float, loss: float) -> None:
    """Carry each frame from one end to the other after `delay` [s], unless it is lost.

    A line `cut` on the standard input cuts the cable, a line `join` joins it; the end of the
    input ends the process.
    """
    generator, order = random.Random(1), itertools.count()
    waiting: list[tuple[float, int, int, bytes]] = []
    whole = True
    while True:
        patience = max(0.0, waiting[0][0] - time.monotonic()) if waiting else 0.5
        for end in select.select((0, *ends), [], [], patience)[0]:
            if end == 0:
                words = os.read(0, 100)
                if not words:
                    return
                whole = words.split()[-1] == b'join'
                continue
            frame = os.read(end, 65_536)
            if whole and generator.random() >= loss:
                other = ends[1] if end == ends[0] else ends[0]
                heapq.heappush(waiting, (time.monotonic() + delay, next(order), other, frame))
        while waiting and waiting[0][0] <= time.monotonic():
            os.write(waiting[0][2], heapq.heappop(waiting)[3])


if __name__ == '__main__':
    carry((int(sys.argv[1]), int(sys.argv[2])), float(sys.argv[3]), float(sys.argv[4]))
