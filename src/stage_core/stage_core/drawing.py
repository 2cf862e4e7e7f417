"""What all pictures share: the style of the pages, an empty canvas, and thinned curves."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator
from itertools import cycle, islice
from typing import Any, ParamSpec

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter
from numpy.typing import NDArray

from stage_core.arrays import Array
from stage_core.theme import SERIES, STYLE

Arguments = ParamSpec('Arguments')
MILLI = 1e3
#: Points of a curve in a picture. More make the page large and show nothing else.
MOST_POINTS = 2000


def styled(draw: Callable[Arguments, Figure]) -> Callable[Arguments, Figure]:
    """Draw in the style of the pages, whatever the settings of the process are."""

    @functools.wraps(draw)
    def drawn(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Figure:
        with matplotlib.rc_context(STYLE):
            return draw(*args, **kwargs)

    return drawn


def canvas(width: float, height: float) -> Figure:
    """An empty figure of this size in inches, on a page of about 11 inches."""
    return Figure(figsize=(width, height), layout='constrained')


def paired(count: int, height: float) -> tuple[Figure, list[Axes]]:
    """A figure and its panels, two in a row, each so many inches high."""
    rows = (count + 1) // 2
    figure = canvas(10.5, height * rows + 0.3)
    panels = figure.subplots(rows, 2, squeeze=False).ravel().tolist()
    for spare in panels[count:]:
        spare.remove()
    return figure, panels[:count]


def legend_above(figure: Figure, panel: Axes, columns: int, **how: float) -> None:
    """One legend for all panels: that of one of them, above the figure."""
    handles = panel.get_legend_handles_labels()
    figure.legend(*handles, loc='outside upper center', ncols=columns, **how)


def colours(count: int) -> Iterator[str]:
    """So many colours of the series, from the start again where they run out."""
    return islice(cycle(SERIES), count)


def plain(axis: Any) -> None:
    """Numbers of a logarithmic axis as a person writes them: 0.1, 1, 10."""
    axis.set_major_formatter(lambda value, _: f'{value:g}')
    axis.set_minor_formatter(NullFormatter())


def thin(count: int, limit: int = MOST_POINTS) -> NDArray[np.int64]:
    """Indices that leave at most ``limit`` of ``count`` samples, evenly."""
    return np.unique(np.linspace(0, count - 1, min(count, limit)).astype(int))


def envelope(values: Array, limit: int = MOST_POINTS) -> NDArray[np.int64]:
    """Indices of the extremes of equal stretches, so that a thinned curve keeps its peaks."""
    count = len(values)
    if count <= limit:
        return np.arange(count)
    stretches = np.array_split(np.arange(count), limit // 2)
    chosen = [(s[np.argmin(values[s])], s[np.argmax(values[s])]) for s in stretches]
    return np.unique(np.array(chosen).ravel())
