"""`ros2 run stage_bringup control`: stage driver and contour controller in one process.

The same nodes with the same parameters, topics and services; encoder state and set-point are
handed over in memory, within the tick. A parameter of one node: ``-p stage_driver:rate:=50.0``.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

from contour_ctrl.node import ContourCtrl
from stage_core.ros.node import StageNode, run
from stage_driver.node import StageDriver


def nodes() -> list[StageNode]:
    """Both nodes, joined; the controller is shut down first."""
    # Its kernels are compiled before the driver's thread begins to count ticks.
    controller = ContourCtrl()
    driver = StageDriver()
    controller.join(driver)
    return [controller, driver]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the nodes."""
    return run(nodes, arguments)


if __name__ == '__main__':
    sys.exit(main())
