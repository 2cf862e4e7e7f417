"""Picture of the hysteresis of an axis: force, and table against motor, in both directions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from stage_core.drawing import MICRO, MILLI, Array, canvas, envelope, styled
from stage_core.theme import BLUE, ORANGE


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
    rows = (len(loops) + 1) // 2
    figure = canvas(10.5, 3.0 * rows + 0.3)
    panels = figure.subplots(rows, 2, squeeze=False).ravel()
    for plot, loop in zip(panels, loops, strict=False):
        scale = 1.0 if loop.force else MICRO
        for sign, name, colour in ((1.0, 'forwards', BLUE), (-1.0, 'backwards', ORANGE)):
            chosen = loop.direction == sign
            position, values = loop.position[chosen], loop.values[chosen]
            index = envelope(values, 800)
            plot.plot(
                position[index] * MILLI, values[index] * scale, '.', ms=3, color=colour, label=name
            )
        what = f'force of {loop.axis} (N)' if loop.force else f'table − motor of {loop.axis} (µm)'
        plot.set(xlabel=f'{loop.axis} (mm)', ylabel=what)
    handles = panels[0].get_legend_handles_labels()
    figure.legend(*handles, loc='outside upper center', ncols=2, markerscale=3)
    for plot in panels[len(loops) :]:
        plot.set_axis_off()
    return figure


def loop_of(axis: str, force: bool, position: Array, values: Array, speed: Array) -> Loop:
    """A loop from the samples in which the axis moves; those at rest have no direction."""
    moving = np.abs(speed) > 1e-9
    return Loop(axis, force, position[moving], values[moving], np.sign(speed[moving]))
