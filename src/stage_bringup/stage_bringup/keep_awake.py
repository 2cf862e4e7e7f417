"""Keeps the processors of this machine awake, for a graph in real time.

    ros2 run stage_bringup keep_awake

A processor without work goes to sleep, a thousand times a second where a loop runs at 1 kHz. On a
virtual machine it is then the host's until the host gives it back, often many ticks later; on
other machines the deep states of sleep take part of a tick. It ends with Ctrl-C.
"""

from __future__ import annotations

import os
import signal
import struct
import subprocess
import sys
import threading
from collections.abc import Sequence
from pathlib import Path

from stage_core.errors import EXIT_BAD_INPUT
from stage_core.signals import ending

#: The kernel keeps the latency that is written here, in us, while the file is open.
LATENCY_FILE = Path('/dev/cpu_dma_latency')
#: Who puts processors to sleep; "none" on most virtual machines: there the file has no effect.
IDLE_DRIVER = Path('/sys/devices/system/cpu/cpuidle/current_driver')

#: Runs where nothing else wants to, on one processor, until its parent has gone. It yields, or
#: other processes under SCHED_IDLE would share their time with it. Linux schedules sessions first
#: and processes within one (autogroup): that of this process must be of low weight as well.
_SPIN = """
import os, sys
processor, parent = int(sys.argv[1]), int(sys.argv[2])
os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))
os.sched_setaffinity(0, {processor})
try:
    with open('/proc/self/autogroup', 'w') as group:
        group.write('19')
except OSError:
    pass
while os.getppid() == parent:
    for _ in range(10_000):
        for _ in range(100):
            pass
        os.sched_yield()
"""


class KeepAwake:
    """Context in which the processors do not sleep; `how` says by what means.

    The kernel's own request where it has an idle driver and permits it, else a process per
    processor under SCHED_IDLE, which gives way to any other at once and needs no permission.
    Where the system has neither (it is not Linux), `how` stays empty.
    """

    def __init__(self, latency_file: Path = LATENCY_FILE, idle_driver: Path = IDLE_DRIVER) -> None:
        self.how = ''
        self._latency_file = latency_file
        self._idle_driver = idle_driver
        self._request: int | None = None
        self._spinning: list[subprocess.Popen[bytes]] = []

    @property
    def pids(self) -> list[int]:
        """Process ids of what keeps the processors busy."""
        return [process.pid for process in self._spinning]

    def __enter__(self) -> KeepAwake:
        """Keep the processors awake from now on."""
        if self._kernel_agrees():
            self.how = f'{self._latency_file} is kept at 0 µs'
            return self
        if not hasattr(os, 'SCHED_IDLE'):
            return self
        for processor in sorted(os.sched_getaffinity(0)):
            line = [sys.executable, '-I', '-S', '-c', _SPIN, str(processor), str(os.getpid())]
            # A session of its own: it lowers the weight of that, and hears no Ctrl-C.
            process = subprocess.Popen(line, stdin=subprocess.DEVNULL, start_new_session=True)
            self._spinning.append(process)
        self.how = f'{len(self._spinning)} processes under SCHED_IDLE'
        return self

    def __exit__(self, *_: object) -> None:
        """Let them sleep again."""
        if self._request is not None:
            os.close(self._request)
            self._request = None
        for process in self._spinning:
            process.kill()
            process.wait()
        self._spinning.clear()

    def _kernel_agrees(self) -> bool:
        try:
            if self._idle_driver.read_text().strip() in ('', 'none'):
                return False
            self._request = os.open(self._latency_file, os.O_WRONLY)
            os.write(self._request, struct.pack('i', 0))
        except OSError:
            return False
        return True


def main(arguments: Sequence[str] | None = None) -> int:
    """Keep the processors awake until a signal ends it."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    if any(argument in ('-h', '--help') for argument in given):
        print(__doc__)
        return 0
    ended = threading.Event()
    for number in ending():
        signal.signal(number, lambda *_: ended.set())
    with KeepAwake() as awake:
        if not awake.how:
            print('error: keep_awake needs Linux: switch power saving off', file=sys.stderr)
            return EXIT_BAD_INPUT
        print(f'the processors stay awake: {awake.how}; Ctrl-C ends it', flush=True)
        ended.wait()
    return 0


if __name__ == '__main__':
    raise SystemExit(main())
