"""Pictures in the plane of the table: errors as arrows, and paths."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from stage_core.arrays import Array
from stage_core.drawing import MILLI, canvas, colours, styled, thin
from stage_core.errors import StageError
from stage_core.quantities import MICROMETRE
from stage_core.theme import BLUE, MUTED, ORANGE
from stage_core.wording import scaled
from stage_reports.figures.checks import pairs

#: The longest arrow spans this share of the workspace.
_LONGEST_ARROW = 0.16


@styled
def error_map(
    points: ArrayLike, before: ArrayLike, after: ArrayLike | None = None, arrows: int = 400
) -> Figure:
    """Errors as arrows over the workspace, uncorrected and, where given, corrected.

    Both maps share one scale, written on the arrow of the key.

    Parameters
    ----------
    points : (n, 2) nominal positions, m. before, after : (n, 2) errors there, m.
    """
    places = pairs('points', points)
    first = 'errors' if after is None else 'before'
    maps = [(first, pairs('errors before', before), ORANGE)]
    if after is not None:
        maps.append(('after', pairs('errors after', after), BLUE))
    if any(values.shape != places.shape for _, values, _ in maps):
        raise StageError('an error map needs one error for each point')
    longest = max(float(np.linalg.norm(values, axis=1).max()) for _, values, _ in maps)
    span = float(np.ptp(places, axis=0).max()) or 1.0
    longest = longest or MICROMETRE
    factor, unit = scaled(longest, 'm')
    # Units of error on a millimetre of the picture.
    scale = longest * factor / (_LONGEST_ARROW * span * MILLI)
    round_length = _round(longest * factor)
    figure = canvas(5.6 * len(maps), 5.2)
    panels = np.atleast_1d(figure.subplots(1, len(maps)))
    # All arrows count in each panel, so that a millimetre is as long in both.
    tips = [places * MILLI + values * factor / scale for _, values, _ in maps]
    for axes, (name, values, colour) in zip(panels, maps, strict=True):
        axes.update_datalim(np.concatenate(tips))
        index = thin(len(places), arrows)
        arrow = _arrows(axes, places[index], factor * values[index], scale, colour)
        axes.quiverkey(arrow, 0.74, 1.03, round_length, f'{round_length:g} {unit}', labelpos='E')
        rms = float(np.sqrt((values**2).sum(axis=1).mean()))
        rms_factor, rms_unit = scaled(rms, 'm')
        axes.set_title(f'{name}: RMS {rms * rms_factor:.2f} {rms_unit}')
    return figure


def _arrows(axes: Any, places: Array, values: Array, scale: float, colour: str) -> Any:
    """Arrows of `values` (n, 2), `scale` of them on a millimetre, at `places` (n, 2) [m]."""
    x, y = places.T * MILLI
    axes.plot(x, y, ls='none', marker='o', ms=3.5, color=MUTED)
    arrow = axes.quiver(
        x, y, *values.T, angles='xy', scale_units='xy', scale=scale, color=colour,
        width=0.007, headwidth=3.6, headlength=4.2, headaxislength=3.8, zorder=3,
    )  # fmt: skip
    axes.set(xlabel='x (mm)', ylabel='y (mm)')
    axes.set_aspect('equal', adjustable='datalim')
    axes.margins(0.06)
    return arrow


def _round(value: float) -> float:
    """The largest of 1, 2 or 5 times a power of ten that is not above a positive value."""
    if not value > 0.0:
        return 1.0
    power = 10.0 ** np.floor(np.log10(value))
    return float(max(step * power for step in (1.0, 2.0, 5.0) if step * power <= value))


@styled
def path_plot(paths: Sequence[tuple[str, ArrayLike]]) -> Figure:
    """Paths in the plane, (name, points (n, 2) in m), with equal axes."""
    figure = canvas(5.6, 5.2)
    axes = figure.subplots()
    for colour, (name, values) in zip(colours(len(paths)), paths, strict=True):
        points = pairs(name, values)
        points = points[thin(len(points))] * MILLI
        axes.plot(points[:, 0], points[:, 1], lw=1.0, color=colour, label=name)
    axes.set(xlabel='x (mm)', ylabel='y (mm)')
    axes.set_aspect('equal', adjustable='datalim')
    axes.legend()
    return figure


@styled
def error_over_axis(
    position: ArrayLike, error: ArrayLike, direction: ArrayLike, axis: str
) -> Figure:
    """Errors of one axis over its position, (n,) m each, apart by the sign of `direction`."""
    p, e, d = (np.asarray(v, dtype=float) for v in (position, error, direction))
    if not p.shape == e.shape == d.shape or p.ndim != 1:
        raise StageError('errors over an axis need a position and a direction each: pass (n,)')
    figure = canvas(5.6, 4.2)
    axes = figure.subplots()
    factor, unit = scaled(float(np.abs(e).max(initial=0.0)), 'm')
    for sign, name, colour, marker in (
        (1.0, 'positive approach', BLUE, '^'),
        (-1.0, 'negative approach', ORANGE, 'v'),
    ):
        chosen = d == sign
        axes.plot(p[chosen] * MILLI, e[chosen] * factor, marker, color=colour, ms=5, label=name)
        if chosen.any():
            axes.axhline(float(e[chosen].mean()) * factor, color=colour, lw=1.0, ls='--')
    axes.set(xlabel=f'{axis} (mm)', ylabel=f'error of {axis} ({unit})')
    axes.legend()
    return figure
