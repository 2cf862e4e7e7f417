"""`ros2 run contour_ctrl excite`: streams the identification reference once, then ends."""

from __future__ import annotations

import signal
import sys
from collections.abc import Sequence
from concurrent.futures import Future

from contour_ctrl.excitation import excitation
from contour_ctrl.feedrate import AxisLimits
from contour_ctrl.sequence import ContourRun, RunSettings
from contour_ctrl.streaming_node import StreamingNode
from contour_ctrl.tick import Controller, Gains
from stage_core.parameters import THREAD_PRIORITY, Parameter
from stage_core.quantities import AXES
from stage_core.ros.node import run

PARAMETERS: tuple[Parameter, ...] = (
    THREAD_PRIORITY,
    Parameter('half_range_x', 0.05, 'travel to each side of the centre', 'm', 1e-6),
    Parameter('half_range_y', 0.05, 'travel to each side of the centre', 'm', 1e-6),
    Parameter('centre_x', 0.0, 'centre of the excitation', 'm'),
    Parameter('centre_y', 0.0, 'centre of the excitation', 'm'),
    Parameter('speeds', [0.002, 0.01, 0.04, 0.1], 'speeds of the reversals', 'm/s', 1e-6),
    Parameter('multisine_time', 10.0, 'duration of the multi-sine', 's', 0.0, 3600.0),
    Parameter('micro_range', 6e-5, 'half range of the micro-motion', 'm', 0.0),
    Parameter('micro_time', 15.0, 'duration of the micro-motion', 's', 0.0, 3600.0),
    Parameter('seed', 0, 'of the phases of the multi-sine', '', 0),
    Parameter('control_rate', 1000.0, 'ticks per second', 'Hz', 1.0, 2000.0),
    Parameter('max_velocity', 0.2, 'limit of each axis', 'm/s', 1e-6, 1e2),
    Parameter('max_acceleration', 2.0, 'limit of each axis', 'm/s^2', 1e-4, 1e4),
    Parameter('max_jerk', 500.0, 'limit of each axis', 'm/s^3', 1e-3, 1e7),
    Parameter('lockstep_timeout', 20.0, 'silence that ends the run in lockstep', 's', 0.1),
    *(Parameter(f'{axis}.position_gain', 40.0, 'K_p', '1/s', 1e-3, 1e4) for axis in AXES),
    *(
        Parameter(f'{axis}.velocity_feedforward', 0.0, 'K_f of the twin file', '', 0.0, 2.0)
        for axis in AXES
    ),
)


class Excite(StreamingNode):
    """Streams the excitation, prints the figures and ends its process."""

    def __init__(self) -> None:
        super().__init__('excite', PARAMETERS)
        value = self.value
        limit = value('max_velocity'), value('max_acceleration'), value('max_jerk')
        reference = excitation(
            (value('half_range_x'), value('half_range_y')),
            (value('centre_x'), value('centre_y')),
            list(value('speeds')),
            value('multisine_time'),
            1.0 / value('control_rate'),
            AxisLimits(*((number, number) for number in limit)),
            seed=value('seed'),
            micro_range=value('micro_range'),
            micro_time=value('micro_time'),
        )
        gains = Gains(
            (value('x.position_gain'), value('y.position_gain')),
            (value('x.velocity_feedforward'), value('y.velocity_feedforward')),
        )
        course = ContourRun(
            Controller(reference, gains), None, 1, RunSettings(lockstep=self.lockstep)
        )
        self.get_logger().info(f'excitation of {len(reference) * reference.period:.1f} s')
        self.failure = ''
        self.begin(course).add_done_callback(self._ended)

    def shutdown(self) -> None:
        """Leave the stage with a target to rest at."""
        self._fault('the excitation was interrupted')

    def _ended(self, done: Future[str]) -> None:
        error = done.exception()
        self.failure = '' if error is None else str(error)
        # Ends the spinning as a user would, so that everything is closed in order.
        signal.raise_signal(signal.SIGTERM)


def main(args: Sequence[str] | None = None) -> int:
    """Run the excitation; exit 2 with one line when it failed."""
    made: list[Excite] = []

    def factory() -> Excite:
        made.append(Excite())
        return made[0]

    status = run(factory, args)
    if made and made[0].failure:
        print(f'error: {made[0].failure}', file=sys.stderr)
        return 2
    return status


if __name__ == '__main__':
    raise SystemExit(main())
