"""What waking up costs this machine: two bare processes send a byte to and fro at 1 kHz.

    python benchmarks/bench_wakeups.py [--ticks 5000]

First with processors that may sleep between two ticks, then beside `keep_awake`. No node on this
machine can be more punctual than that.
"""

from __future__ import annotations

import argparse
import os
import socket
import time

import numpy as np

from stage_bringup.keep_awake import KeepAwake

PERIOD = 1e-3
#: Later than this [s], the deadlines move.
LONGEST_LAG = 0.02


def ticks(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Lateness of each tick and time of each answer (count,) [s]."""
    here, there = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    child = os.fork()
    if child == 0:
        while (data := there.recv(1)) != b'e':
            there.send(data)
        os._exit(0)
    late, answered = np.zeros(count), np.zeros(count)
    deadline = time.monotonic()
    for k in range(count):
        deadline += PERIOD
        if (left := deadline - time.monotonic()) > 0.0:
            time.sleep(left)
        woken = time.monotonic()
        late[k] = woken - deadline
        deadline = max(deadline, woken - LONGEST_LAG)
        here.send(b't')
        here.recv(1)
        answered[k] = time.monotonic() - woken
    here.send(b'e')
    os.waitpid(child, 0)
    return late, answered


def line(name: str, late: np.ndarray, answered: np.ndarray) -> str:
    """One row of the table."""
    figures = [
        f'{1e6 * np.median(values):7.0f} {1e6 * np.percentile(values, 99):9.0f} '
        f'{1e6 * values.max():9.0f}'
        for values in (late, answered)
    ]
    return f'{name:10}{figures[0]}   {figures[1]}   {100.0 * np.mean(late > PERIOD):7.2f} %'


def main() -> None:
    """Print both rows and their ratio."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--ticks', type=int, default=5000)
    count = parser.parse_args().ticks
    asleep = ticks(count)
    with KeepAwake() as awake:
        time.sleep(0.2)
        kept = ticks(count)
    print(
        f'{"us":10}{"late: median, 99 %, worst":>27}   {"answer: the same":>27}   late by > 1 ms'
    )
    print(line('asleep', *asleep))
    print(line('awake', *kept) + f'   ({awake.how})')
    ratio = np.percentile(asleep[1], 99) / np.percentile(kept[1], 99)
    print(f'99 % of the answers: {ratio:.1f} times as long asleep')


if __name__ == '__main__':
    main()
