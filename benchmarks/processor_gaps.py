"""Times at which a processor of this machine ran nothing: what no program on it can keep up with.

As the threads of `cyclictest`, a process per processor at high priority (SCHED_FIFO) wakes every
half millisecond and notes when it came late: only the kernel, or the host of a virtual machine,
can do that.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

INTERVAL = 5e-4
#: Late by less than this is the ordinary cost of a timer [s].
SHORTEST = 1e-3
REFUSED = 'refused'


def processor_time() -> tuple[int, int]:
    """Processor time that the host of a virtual machine kept, and all of it, since the start."""
    fields = [int(text) for text in Path('/proc/stat').read_text().split('\n', 1)[0].split()[1:9]]
    return fields[7], sum(fields)


def watch(processor: int) -> None:
    """Print the length [s] of each gap until the parent has gone."""
    parent = os.getppid()
    os.sched_setaffinity(0, {processor})
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(98))
    except PermissionError:
        print(REFUSED, flush=True)
    before = time.monotonic()
    while os.getppid() == parent:
        time.sleep(INTERVAL)
        now = time.monotonic()
        if now - before - INTERVAL > SHORTEST:
            print(now - before - INTERVAL, flush=True)
        before = now


class ProcessorGaps:
    """Context that watches every processor; afterwards `text` tells what was seen."""

    def __enter__(self) -> ProcessorGaps:
        """Begin to watch."""
        self._watchers = [
            subprocess.Popen(
                [sys.executable, '-S', str(Path(__file__)), str(processor)],
                stdout=subprocess.PIPE,
                text=True,
            )
            for processor in sorted(os.sched_getaffinity(0))
        ]
        self._begin, self._spent = time.monotonic(), processor_time()
        return self

    def __exit__(self, *_: object) -> None:
        """End the watchers."""
        duration = time.monotonic() - self._begin
        kept, spent = (b - a for a, b in zip(self._spent, processor_time(), strict=True))
        parts, refused = [], ''
        for watcher in self._watchers:
            watcher.terminate()
            lines = watcher.communicate()[0].splitlines()
            if REFUSED in lines:
                lines.remove(REFUSED)
                refused = ' (without SCHED_FIFO: the kernel, too, gave others the processor)'
            lengths = [float(line) for line in lines]
            longest, share = 1e3 * max(lengths, default=0.0), 100.0 * sum(lengths) / duration
            parts.append(f'{len(lengths)}, longest {longest:.1f} ms, together {share:.1f} %')
        host = f'the host kept {100 * kept / spent:.1f} %'
        self.text = f'{host}, gaps of each processor above 1 ms: {"; ".join(parts)}{refused}'


if __name__ == '__main__':
    watch(int(sys.argv[1]))
