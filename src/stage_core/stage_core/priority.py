"""Processor priority: what controls the stage goes first, computations go last."""

from __future__ import annotations

import os

#: Niceness of a training or a diagnosis: it takes what the nodes leave.
BACKGROUND = 10


def to_background(process: int = 0) -> None:
    """Lower the priority of a process (0: this one) and of what it will start."""
    if hasattr(os, 'setpriority'):
        lowered = max(BACKGROUND, os.getpriority(os.PRIO_PROCESS, process))
        os.setpriority(os.PRIO_PROCESS, process, lowered)
