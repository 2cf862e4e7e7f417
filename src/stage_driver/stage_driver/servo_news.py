"""What a tick has to tell its listeners, after its force is on the way."""

from __future__ import annotations

from stage_core import drive_link
from stage_core.clocks import NANOSECONDS
from stage_driver.backend import Listener
from stage_driver.servo_axes import ServoAxes


class News:
    """The measurement and the control of the newest tick, each told once.

    A clock that waits tells the measurement before the force is computed, the other one after it.
    """

    def __init__(self, axes: ServoAxes, listener: Listener) -> None:
        self._axes, self._listener = axes, listener
        self._datagram: drive_link.Datagram | None = None
        self._controlled: int | None = None
        self._last_second = -1

    def measured(self, datagram: drive_link.Datagram) -> None:
        """Take note of a measurement; the positions themselves are told at once."""
        self._datagram = datagram
        self._listener.on_measured(datagram.stamp, self._axes.encoder.tolist())

    def controlled(self, stamp: int) -> None:
        """Take note of a force that was sent for the tick of a stamp [ns]."""
        self._controlled = stamp

    def tell(self) -> None:
        """Tell what is new; temperatures once a second."""
        axes, datagram, stamp = self._axes, self._datagram, self._controlled
        self._datagram = self._controlled = None
        if datagram is not None:
            at = datagram.stamp
            self._listener.on_state(at, axes.encoder.tolist(), axes.velocity.tolist())
            if at // NANOSECONDS != self._last_second and datagram.temperatures:
                self._last_second = at // NANOSECONDS
                self._listener.on_temperatures(at, drive_link.SENSORS, datagram.temperatures)
        if stamp is not None:
            motion = axes.motion
            self._listener.on_control(
                stamp,
                motion.reference.tolist(),
                motion.speed.tolist(),
                axes.command.tolist(),
                axes.force.tolist(),
            )
