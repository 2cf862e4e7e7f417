"""Curves of a picture as data, for the script that reads values off it and zooms in a browser."""

from __future__ import annotations

import functools
import json
from importlib.resources import files
from typing import Any

from stage_core.theme import COLOURS

_NAMES = {light: name for name, (light, _) in COLOURS.items()}


@functools.cache
def script() -> str:
    """The script of a page with such pictures."""
    return (files('stage_core') / 'explore.js').read_text(encoding='utf-8')


def data(figure: Any) -> str:
    """JSON of the panels of a matplotlib figure, safe inside a script element.

    Each panel has its `box` (left, top, width, height) and `outer` box with its labels (left, top,
    right, bottom) as shares of the picture, limits `x`, and its named curves.
    """
    figure.draw_without_rendering()
    panels = [_panel(axes) for axes in figure.axes if axes.axison and axes.name == 'rectilinear']
    found = [panel for panel in panels if panel['curves']]
    # A name from a bag must not end the script element.
    return json.dumps(found, ensure_ascii=False, separators=(',', ':')).replace('<', '\\u003c')


def _panel(axes: Any) -> dict[str, Any]:
    left, bottom, width, height = axes.get_position().bounds
    outer = axes.get_tightbbox().transformed(axes.figure.transFigure.inverted())
    return {
        'name': axes.get_ylabel(),
        'xname': axes.get_xlabel(),
        'box': [_short(v) for v in (left, 1.0 - bottom - height, width, height)],
        'outer': [_short(v) for v in (outer.x0, 1.0 - outer.y1, outer.x1, 1.0 - outer.y0)],
        'x': [_short(v) for v in axes.get_xlim()],
        'xlog': axes.get_xscale() == 'log',
        'ylog': axes.get_yscale() == 'log',
        'curves': [_curve(line) for line in axes.lines if not line.get_label().startswith('_')],
    }


def _curve(line: Any) -> dict[str, Any]:
    colour = line.get_color()
    return {
        'name': line.get_label(),
        'colour': _NAMES.get(colour, colour),
        'width': line.get_linewidth(),
        'alpha': line.get_alpha() or 1.0,
        'dashed': line.get_linestyle() != '-',
        'x': [_short(v) for v in line.get_xdata()],
        'y': [_short(v) for v in line.get_ydata()],
    }


def _short(value: float) -> float:
    """Six digits: more than a screen shows."""
    return float(f'{value:.6g}')
