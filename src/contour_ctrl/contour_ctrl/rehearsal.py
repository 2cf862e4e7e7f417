"""Contours on the servo twin without the graph: rehearsal before the stage, and benchmarks."""

from __future__ import annotations

import numpy as np

from contour_ctrl.figures import Figures, figures
from contour_ctrl.learning import Learner
from contour_ctrl.tick import EX, QX, Controller, tick
from stage_core.arrays import Array
from stage_core.twin_file import TwinFile
from stage_twin.compiled import compiled
from stage_twin.kernel import (
    advance,
    encoder,
    estimate_velocity,
    start_controller,
    start_plant,
    velocity_loop,
)
from stage_twin.packing import KernelArrays, Work, pack


@compiled
def _run(
    machine: KernelArrays,
    work: Work,
    external: Array,
    force: Array,
    start: Array,
    command: Array,
    arrays: tuple[Array, ...],
) -> None:
    axes, period = machine.axes, machine.period
    count = force.shape[1]
    state, loop, q, _ = work
    start_plant(axes, start, state)
    for axis in range(2):
        q[axis] = encoder(axes[axis], state[axis])
    start_controller(q, loop)
    for k in range(count):
        for axis in range(2):
            q[axis] = encoder(axes[axis], state[axis])
            estimate_velocity(axes[axis], period, loop[axis], q[axis])
        tick(k, q[0], q[1], *arrays)
        for axis in range(2):
            force[axis, k] = velocity_loop(axes[axis], period, loop[axis], command[axis])
        if k + 1 < count:
            advance(machine, state, force, k, external[k])


class Rehearsal:
    """Runs a controller on a servo twin, from rest at the start of the contour.

    Parameters
    ----------
    twin
        A servo twin with axes x and y; its effects are the reality.
    """

    def __init__(self, twin: TwinFile) -> None:
        self.machine: KernelArrays = pack(twin)

    def run(self, controller: Controller, external: Array | None = None) -> Figures:
        """Run once; the record stays in `controller.record`.

        `external` (n, 2) [N] acts on the moving masses. Figures use the exact contour error.
        """
        count = len(controller)
        controller.restart()
        _run(
            self.machine,
            Work.of(2),
            np.zeros((count, 2)) if external is None else external,
            np.zeros((2, count)),
            controller.reference.position[0].copy(),
            controller.command,
            controller.arrays,
        )
        reference = controller.reference
        contour = reference.contour_errors(controller.record[:, QX : QX + 2])
        return figures(controller.record[:, EX : EX + 2], contour)

    def iterate(
        self,
        controller: Controller,
        learner: Learner | None,
        iterations: int,
        external: list[Array] | None = None,
    ) -> list[Figures]:
        """Run `iterations` times, learning in between; `external` holds one array per run."""
        results = []
        for index in range(iterations):
            results.append(self.run(controller, None if external is None else external[index]))
            if learner is not None and index + 1 < iterations:
                learner.after(controller)
        return results
