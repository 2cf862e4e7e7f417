"""Curves of a picture as data, for the script that reads values off it and zooms in a browser."""

from __future__ import annotations

import functools
import json
from collections.abc import Sequence
from importlib.resources import files
from typing import Any

from stage_core.theme import COLOURS

#: Where each panel is, see `places`.
Places = list[dict[str, list[float]]]
_NAMES = {light: name for name, (light, _) in COLOURS.items()}


@functools.cache
def script() -> str:
    """The script of a page with such pictures."""
    return (files('stage_core') / 'explore.js').read_text(encoding='utf-8')


def data(figure: Any, places: Sequence[Places]) -> str:
    """JSON of the panels of a matplotlib figure, safe inside a script element.

    Each panel has its `places`, limits `x`, and its named curves.

    Parameters
    ----------
    places : those of the figure as it is, then where there is one, those in one column.
    """
    own = [list(of_panel) for of_panel in zip(*places, strict=True)]
    found = [{**_panel(a), 'places': p} for a, p in zip(_panels(figure), own, strict=True)]
    # A name from a bag must not end the script element.
    return json.dumps(found, ensure_ascii=False, separators=(',', ':')).replace('<', '\\u003c')


def places(figure: Any) -> Places:
    """Where the panels with curves are in a picture that is laid out, as shares of it.

    Each has a `box` (left, top, width, height) and with its labels an `outer` one (left, top,
    right, bottom).
    """
    return [_place(axes) for axes in _panels(figure)]


def _panels(figure: Any) -> list[Any]:
    drawn = (axes for axes in figure.axes if axes.axison and axes.name == 'rectilinear')
    return [axes for axes in drawn if _named(axes)]


def _named(axes: Any) -> list[Any]:
    return [line for line in axes.lines if not line.get_label().startswith('_')]


def _place(axes: Any) -> dict[str, list[float]]:
    left, bottom, width, height = axes.get_position().bounds
    outer = axes.get_tightbbox().transformed(axes.figure.transFigure.inverted())
    return {
        'box': [_short(v) for v in (left, 1.0 - bottom - height, width, height)],
        'outer': [_short(v) for v in (outer.x0, 1.0 - outer.y1, outer.x1, 1.0 - outer.y0)],
    }


def _panel(axes: Any) -> dict[str, Any]:
    return {
        'name': axes.get_ylabel(),
        'xname': axes.get_xlabel(),
        'x': [_short(v) for v in axes.get_xlim()],
        'xlog': axes.get_xscale() == 'log',
        'ylog': axes.get_yscale() == 'log',
        'curves': [_curve(line) for line in _named(axes)],
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
