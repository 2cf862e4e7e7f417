"""Processor priority: what controls the stage goes first, computations go last."""

from __future__ import annotations

import os
from pathlib import Path

_THREADS = Path('/proc/self/task')

#: Niceness of a training or a diagnosis: it takes what the nodes leave.
BACKGROUND = 10


def to_background(process: int = 0) -> None:
    """Lower the priority of a process (0: this one) and of what it will start."""
    if hasattr(os, 'setpriority'):
        lowered = max(BACKGROUND, os.getpriority(os.PRIO_PROCESS, process))
        os.setpriority(os.PRIO_PROCESS, process, lowered)


def to_real_time(priority: int) -> str:
    """Give every thread that this process has SCHED_FIFO at `priority`; 0 changes nothing.

    A thread of an ordinary process waits for the end of another's time slice, often for longer
    than a tick of 1 ms. Threads and processes begun later are ordinary again.

    Returns
    -------
    What came of it, for /diagnostics.
    """
    if priority <= 0:
        return 'ordinary'
    if not hasattr(os, 'SCHED_RESET_ON_FORK'):
        return 'ordinary: this system has no SCHED_FIFO'
    policy = os.SCHED_FIFO | os.SCHED_RESET_ON_FORK
    for thread in _THREADS.iterdir():
        try:
            os.sched_setscheduler(int(thread.name), policy, os.sched_param(priority))
        except ProcessLookupError:
            # It has ended meanwhile.
            continue
        except OSError as error:
            return f'ordinary: SCHED_FIFO {priority} was refused ({error.strerror})'
    return f'SCHED_FIFO {priority}'
