"""How long the tests wait for what must come."""

from __future__ import annotations

import time
from collections.abc import Callable

#: Patience for anything that a loaded machine must do [s]; nothing is asserted about it. Beside
#: twenty processes on two cores, calls that take a second of a core took a minute.
PATIENCE = 300.0


def wait(condition: Callable[[], object], what: object = 'what must come') -> None:
    """Wait until a condition holds; `what` tells it, or is asked what there is instead."""
    deadline = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < deadline, what() if callable(what) else what
        time.sleep(0.005)
