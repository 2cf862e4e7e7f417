"""Pictures of a contour that is run several times: the error along it, and magnified on it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from stage_core.drawing import MICRO, Array, canvas, colours, envelope, styled
from stage_core.errors import StageError
from stage_core.theme import INK

#: Name, place along the path (n,), contour error there (n,) [m].
Run = tuple[str, Array, Array]


def _check(runs: Sequence[Run]) -> None:
    if not runs or any(len(p) != len(e) or not len(e) for _, p, e in runs):
        raise StageError('a picture of a contour needs one error for each place of each run')


@styled
def error_over_path(runs: Sequence[Run], label: str) -> Figure:
    """Contour error of some runs over the place along the path; `label` names the place."""
    _check(runs)
    figure = canvas(10.5, 3.6)
    axes = figure.subplots()
    for colour, (name, place, error) in zip(colours(len(runs)), runs, strict=True):
        index = envelope(error)
        axes.plot(place[index], error[index] * MICRO, lw=1.0, color=colour, label=name)
    axes.set(xlabel=label, ylabel='contour error (µm)')
    axes.margins(x=0.01)
    axes.legend(ncols=len(runs), loc='upper right')
    return figure


@styled
def contour_polar(runs: Sequence[Run], radius: float) -> Figure:
    """Contour error of some laps of a circle over its angle (rad), magnified on the circle.

    Parameters
    ----------
    radius : of the circle, m; the title states the magnification.
    """
    _check(runs)
    figure = canvas(5.6, 5.8)
    axes = figure.add_subplot(projection='polar')
    widest = max(float(np.abs(e).max()) for _, _, e in runs) * MICRO or 1.0
    turn = np.linspace(0.0, 2.0 * np.pi, 181)
    axes.plot(turn, np.zeros_like(turn), color=INK, lw=0.9, label='nominal circle')
    for colour, (name, angle, error) in zip(colours(len(runs)), runs, strict=True):
        index = envelope(error)
        axes.plot(angle[index], error[index] * MICRO, lw=1.0, color=colour, label=name)
    axes.set_ylim(-3.0 * widest, 1.25 * widest)
    axes.set_rlabel_position(67.5)
    magnified = radius * MICRO / (3.0 * widest)
    axes.set_title(
        f'error magnified about {float(f"{magnified:.2g}"):.0f} times', fontsize=10, loc='center'
    )
    figure.legend(loc='outside lower center', ncols=3)
    return figure
