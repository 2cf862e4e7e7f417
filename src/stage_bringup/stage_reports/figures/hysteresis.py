"""Picture of the hysteresis of an axis: force, and table against motor, in both directions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from stage_core.arrays import Array
from stage_core.drawing import MILLI, envelope, legend_above, paired, styled
from stage_core.theme import BLUE, ORANGE
from stage_core.wording import scaled


@dataclass(frozen=True)
class Loop:
    """A quantity of one axis over its position (n,) m, with the sign (n,) of its velocity.

    `values` (n,) are a force in N where `force`, else table minus motor in m.
    """

    axis: str
    force: bool
    position: Array
    values: Array
    direction: Array


@styled
def hysteresis_loops(loops: Sequence[Loop]) -> Figure:
    """One panel a loop, two in a row; forwards and backwards in two colours."""
    figure, panels = paired(len(loops), 3.0)
    for plot, loop in zip(panels, loops, strict=True):
        scale, unit = 1.0, 'N'
        if not loop.force:
            scale, unit = scaled(float(np.abs(loop.values).max(initial=0.0)), 'm')
        for sign, name, colour in ((1.0, 'forwards', BLUE), (-1.0, 'backwards', ORANGE)):
            chosen = loop.direction == sign
            position, values = loop.position[chosen], loop.values[chosen]
            index = envelope(values, 800)
            plot.plot(
                position[index] * MILLI, values[index] * scale, '.', ms=3, color=colour, label=name
            )
        what = 'force' if loop.force else 'table − motor'
        plot.set(xlabel=f'{loop.axis} (mm)', ylabel=f'{what} of {loop.axis} ({unit})')
    legend_above(figure, panels[0], 2, markerscale=3)
    return figure


def loop_of(axis: str, force: bool, position: Array, values: Array, speed: Array) -> Loop:
    """A loop from the samples in which the axis moves; those at rest have no direction."""
    moving = np.abs(speed) > 1e-9
    return Loop(axis, force, position[moving], values[moving], np.sign(speed[moving]))
