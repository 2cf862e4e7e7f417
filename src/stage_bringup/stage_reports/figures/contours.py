"""Pictures of a contour that is run several times: the error along it, and magnified on it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.projections.polar import PolarAxes
from matplotlib.ticker import MultipleLocator

from stage_core.arrays import Array
from stage_core.drawing import canvas, colours, envelope, styled
from stage_core.errors import StageError
from stage_core.quantities import MICROMETRE
from stage_core.theme import INK
from stage_core.wording import scaled

#: Name, place along the path (n,), contour error there (n,) [m].
Run = tuple[str, Array, Array]


def _check(runs: Sequence[Run]) -> float:
    """The largest error [m]."""
    if not runs or any(len(p) != len(e) or not len(e) for _, p, e in runs):
        raise StageError('a picture of a contour needs one error for each place of each run')
    return max(float(np.abs(e).max()) for _, _, e in runs)


@styled
def error_over_path(runs: Sequence[Run], label: str) -> Figure:
    """Contour error of some runs over the place along the path; `label` names the place."""
    factor, unit = scaled(_check(runs), 'm')
    figure = canvas(10.5, 3.6)
    axes = figure.subplots()
    for colour, (name, place, error) in zip(colours(len(runs)), runs, strict=True):
        index = envelope(error)
        axes.plot(place[index], error[index] * factor, lw=1.0, color=colour, label=name)
    axes.set(xlabel=label, ylabel=f'contour error ({unit})')
    if '°' in label:
        # An axis reverses at each multiple of 90°.
        axes.xaxis.set_major_locator(MultipleLocator(45.0))
    axes.margins(x=0.01)
    axes.legend(ncols=len(runs), loc='upper right')
    return figure


@styled
def contour_polar(runs: Sequence[Run], radius: float) -> Figure:
    """Contour error of some laps of a circle over its angle (rad), magnified on the circle.

    Parameters
    ----------
    radius : of the circle, m.
    """
    widest = _check(runs) or MICROMETRE
    factor, unit = scaled(widest, 'm')
    figure = canvas(5.6, 5.8)
    axes = figure.add_subplot(projection='polar')
    for colour, (name, angle, error) in zip(colours(len(runs)), runs, strict=True):
        index = envelope(error)
        axes.plot(angle[index], error[index] * factor, lw=1.0, color=colour, label=name)
    axes.set_title(
        f'contour error in {unit}, {on_circle(axes, radius, widest, factor)}',
        fontsize=10,
        loc='center',
    )
    figure.legend(loc='outside lower center', ncols=3)
    return figure


def on_circle(axes: PolarAxes, radius: float, widest: float, factor: float) -> str:
    """Draw the nominal circle with room for errors up to `widest` [m]; the magnification.

    Errors are drawn `factor` times their metres.
    """
    turn = np.linspace(0.0, 2.0 * np.pi, 181)
    axes.plot(turn, np.zeros_like(turn), color=INK, lw=0.9, zorder=1, label='nominal circle')
    axes.set_ylim(-3.0 * widest * factor, 1.5 * widest * factor)
    axes.set_rlabel_position(67.5)
    return f'magnified about {float(f"{radius / (3.0 * widest):.2g}"):.0f} times'
