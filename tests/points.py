"""What tests of the plant's loops share."""

from __future__ import annotations

from stage_core.twin_file import StepperAxis, TrackerSpec, TwinFile

#: A stepper whose rests scatter, before a tracker.
TWIN = TwinFile(
    kind='stepper',
    axes={'x': StepperAxis(), 'y': StepperAxis()},
    tracker=TrackerSpec(rate=100.0, noise=1e-6),
    repeatability=3e-6,
)


class PointRecorder:
    """Takes the place of the tracker's sockets: keeps (time [ns], point [m])."""

    def __init__(self) -> None:
        self.points: list[tuple[int, tuple[float, float, float]]] = []
        #: Number of points that were there at the last flush.
        self.flushed = 0

    def push(self, time_ns: int, point: tuple[float, float, float]) -> None:
        """Take a point."""
        self.points.append((time_ns, point))

    def flush(self) -> None:
        """Note that all points so far must have been written."""
        self.flushed = len(self.points)
