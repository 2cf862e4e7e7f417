"""A controller in the driver's process: ticks and set-points are calls, topics are for watching.

The driver's thread hands over each measurement and takes the answer within the tick. What takes
longer than a tick (learning, the plan of a feed hold) and what comes meanwhile goes to a thread
of its own, in order, as the messages of a topic would wait.
"""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable, Sequence
from typing import Any

from stage_core.ros.joint_state_wire import JointSample


class Joined:
    """Between a driver and a controller of the same process.

    Parameters
    ----------
    axes
        Of the driver's measurements, in their order.
    lock
        Guards the controller's run; the driver's thread never waits for it.
    prompt
        Whether the controller answers a stamp [ns] within microseconds; called with the lock.
    answer
        Lets the controller take a measurement; called with the lock.
    """

    def __init__(
        self,
        axes: Sequence[str],
        lock: threading.RLock,  # type: ignore[valid-type]
        prompt: Callable[[int], bool],
        answer: Callable[[JointSample], None],
    ) -> None:
        self._axes = axes
        self._lock: Any = lock
        self._prompt, self._answer = prompt, answer
        self._waiting: queue.SimpleQueue[JointSample] = queue.SimpleQueue()
        # Each is written by one thread only: what was handed over, and what of it is done.
        self._handed = self._done = 0
        self._within_tick = False
        self._kept_back: list[tuple[Any, Any]] = []
        threading.Thread(target=self._work, name='contour', daemon=True).start()

    def measured(self, stamp: int, positions: Sequence[float]) -> None:
        """See `stage_driver.backend.Controller`."""
        sample = JointSample(stamp, self._axes, positions, ())
        if self._handed == self._done and self._lock.acquire(blocking=False):
            try:
                if self._prompt(stamp):
                    self._within_tick = True
                    self._answer(sample)
                    return
            finally:
                self._within_tick = False
                self._lock.release()
        self._handed += 1
        self._waiting.put(sample)

    def told(self) -> None:
        """See `stage_driver.backend.Controller`."""
        kept, self._kept_back = self._kept_back, []
        for publisher, message in kept:
            publisher.publish(message)

    def publish(self, publisher: Any, message: Any) -> None:
        """Publish now, or after the force where a tick is being answered; called with the lock."""
        if self._within_tick:
            self._kept_back.append((publisher, message))
        else:
            publisher.publish(message)

    def _work(self) -> None:
        while True:
            sample = self._waiting.get()
            with self._lock:
                self._answer(sample)
            self._done += 1
