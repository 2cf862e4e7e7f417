"""Colours of pages and pictures in light and dark, and the style in which pictures are drawn.

A picture is drawn in the light colours. As SVG it carries the dark ones too, so that one file fits
the page in either theme.
"""

from __future__ import annotations

import contextlib
import io
from collections.abc import Iterator
from typing import Any

import numpy as np

#: Name -> (light, dark). The six series stay apart for the colour-blind (Okabe and Ito 2008).
COLOURS: dict[str, tuple[str, str]] = {
    'ink': ('#1c2228', '#e3e7eb'),
    'muted': ('#5b6671', '#9aa6b2'),
    'rule': ('#d5dade', '#3a434c'),
    'blue': ('#0072b2', '#56b4e9'),
    'orange': ('#d55e00', '#f0894a'),
    'green': ('#009e73', '#2fc79a'),
    'purple': ('#a8558a', '#d98cbd'),
    'yellow': ('#b07d00', '#e6b422'),
    'cyan': ('#2b8fc7', '#8fd0f5'),
}
INK, MUTED, RULE, BLUE, ORANGE, GREEN, PURPLE, YELLOW, CYAN = (c[0] for c in COLOURS.values())
SERIES = (BLUE, ORANGE, GREEN, PURPLE, YELLOW, CYAN)

#: Width (inches) of a picture on a phone: its letters of 10 points are then 10 pixels high.
NARROW = 4.8

#: What matplotlib's `rc_context` takes. Backgrounds are clear: the page's shows through.
STYLE: dict[str, Any] = {
    'figure.facecolor': 'none',
    'axes.facecolor': 'none',
    'axes.edgecolor': MUTED,
    'axes.labelcolor': INK,
    'axes.titlecolor': INK,
    'axes.titlesize': 11.0,
    'axes.titlelocation': 'left',
    'axes.spines.top': False,
    'axes.spines.right': False,
    'axes.grid': True,
    'axes.axisbelow': True,
    'grid.color': RULE,
    'grid.linewidth': 0.8,
    'text.color': INK,
    'xtick.color': MUTED,
    'ytick.color': MUTED,
    'xtick.labelcolor': INK,
    'ytick.labelcolor': INK,
    'legend.frameon': False,
    'legend.fontsize': 9.0,
    'font.size': 10.0,
}


def variables(theme: int) -> str:
    """Declarations of the colours as CSS variables; `theme` 0 is light, 1 dark."""
    return ''.join(f'--{name}:{pair[theme]};' for name, pair in COLOURS.items())


def svg(figure: Any) -> str:
    """A matplotlib figure as SVG text whose colours follow the reader's theme."""
    # Whoever has a figure has matplotlib; the rest of this package does without it.
    import matplotlib
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    buffer, canvas, dpi = io.StringIO(), figure.canvas, figure.dpi
    # With a salt of its own, equal figures make equal files. `savefig` would draw twice.
    with matplotlib.rc_context({'svg.fonttype': 'path', 'svg.hashsalt': 'stage'}):
        FigureCanvasSVG(figure).print_svg(buffer, metadata={'Date': None, 'Creator': None})
    figure.set_canvas(canvas)
    figure.set_dpi(dpi)
    text = buffer.getvalue()
    text = text[text.index('<svg') :]
    for name, (light, _) in COLOURS.items():
        text = text.replace(light, f'var(--{name})')
    style = (
        f'<style>:root{{{variables(0)}fill:var(--ink)}}'
        f'@media screen and (prefers-color-scheme:dark){{:root{{{variables(1)}}}}}</style>'
    )
    head = text.index('>') + 1
    return text[:head] + style + text[head:]


@contextlib.contextmanager
def laid_out(figure: Any) -> Iterator[None]:
    """Inside the block everything in a figure stays where one layout has put it.

    To lay it out takes as long as to draw it, and is done at each use otherwise.
    """
    engine = figure.get_layout_engine()
    engine.execute(figure)
    figure.set_layout_engine('none')
    yield
    figure.set_layout_engine(engine)


@contextlib.contextmanager
def one_column(figure: Any) -> Iterator[None]:
    """Inside the block the panels of a wide figure stand in one column, as a phone shows them."""
    panels = [axes for axes in figure.axes if axes.get_subplotspec() is not None]
    places = [axes.get_subplotspec() for axes in panels]
    size = figure.get_size_inches().copy()
    columns = max((place.colspan.stop for place in places), default=1)
    if columns > 1:
        grid = figure.add_gridspec(len(panels), 1)
        order = np.lexsort(([p.rowspan.start for p in places], [p.colspan.start for p in places]))
        for row, number in enumerate(order.tolist()):
            panels[number].set_subplotspec(grid[row])
    figure.set_size_inches(NARROW, size[1] * columns)
    yield
    figure.set_size_inches(*size)
    for axes, place in zip(panels, places, strict=True):
        axes.set_subplotspec(place)
