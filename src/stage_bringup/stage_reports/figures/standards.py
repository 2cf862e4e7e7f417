"""Pictures of the standard tests: ISO 230-2 bands and the ISO 230-4 polar plot."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from stage_core.drawing import MILLI, canvas, styled, thin
from stage_core.quantities import MICROMETRE
from stage_core.theme import BLUE, INK, MUTED, ORANGE
from stage_core.wording import measure, scaled, with_std
from stage_reports.figures.checks import pairs
from stage_reports.figures.contours import on_circle
from stage_reports.iso230 import Circular, Positioning


@styled
def positioning_plot(
    result: Positioning, uncertain: Mapping[str, float], axis_name: str = ''
) -> Figure:
    """Positioning deviations over the targets as ISO 230-2 draws them: means and bands of 2 s.

    A bracket on the right spans the accuracy A, the bar beside it the expanded uncertainty of A.
    `uncertain` holds the expanded uncertainty U (m) of A, R, E and B.
    """
    figure = canvas(6.4, 4.2)
    axes = figure.subplots()
    position = result.targets * MILLI
    factor, unit = scaled(max(abs(result.mean).max(), result.A), 'm')
    for name, mean, s, colour, marker in (
        ('positive approach', result.mean_up, result.deviation_up, BLUE, '^'),
        ('negative approach', result.mean_down, result.deviation_down, ORANGE, 'v'),
    ):
        low, high = (mean - 2.0 * s) * factor, (mean + 2.0 * s) * factor
        axes.fill_between(position, low, high, color=colour, alpha=0.18, lw=0)
        axes.plot(position, mean * factor, color=colour, marker=marker, label=f'{name}, ± 2 s')
    axes.plot(position, result.mean * factor, color=MUTED, ls='--', label='mean of both')
    top = max((result.mean_up + 2 * result.deviation_up).max(),
              (result.mean_down + 2 * result.deviation_down).max())  # fmt: skip
    place = position.max() + 0.06 * float(np.ptp(position) or 1.0)
    axes.annotate(
        '', (place, top * factor), (place, (top - result.A) * factor),
        arrowprops={'arrowstyle': '<->', 'color': INK}, annotation_clip=False,
    )  # fmt: skip
    beside = place + 0.05 * float(np.ptp(position) or 1.0)
    axes.errorbar(beside, top * factor, yerr=uncertain['A'] * factor, color=INK, capsize=3)
    axes.text(beside, top * factor, '  ± U', va='center')
    axes.text(place, (top - 0.5 * result.A) * factor, ' A', va='center')
    figures = ', '.join(f'{n} {with_std(getattr(result, n), uncertain[n])}' for n in 'AREB')
    axes.set(
        title=f'{axis_name} by ISO 230-2, ± U (k = 2):\n{figures}'.strip(),
        xlabel='target position (mm)',
        ylabel=f'deviation ({unit})',
    )
    axes.legend(loc='best')
    return figure


@styled
def circular_plot(
    result: Circular, counter_clockwise: ArrayLike, clockwise: ArrayLike | None = None
) -> Figure:
    """Radial deviations over the angle, magnified about the nominal circle (ISO 230-4)."""
    figure = canvas(5.6, 5.8)
    axes = figure.add_subplot(projection='polar')
    paths = [('counter-clockwise', pairs('path', counter_clockwise), BLUE)]
    if clockwise is not None:
        paths.append(('clockwise', pairs('path', clockwise), ORANGE))
    widest = max(abs(result.F_max), abs(result.F_min)) or MICROMETRE
    factor, unit = scaled(widest, 'm')
    for name, path, colour in paths:
        offset = path[thin(len(path))] - result.centre
        deviation = np.linalg.norm(offset, axis=1) - result.radius
        angle = np.arctan2(offset[:, 1], offset[:, 0])
        # A jump of the angle's branch would draw a line across the circle.
        deviation[1:][np.abs(np.diff(angle)) > np.pi] = np.nan
        axes.plot(angle, deviation * factor, color=colour, lw=0.9, label=name)
    magnified = on_circle(axes, result.radius, widest, factor)
    axes.set_title(
        f'{_circular_figures(result)}\nradial deviation in {unit}, {magnified}',
        fontsize=10,
        loc='center',
    )
    figure.legend(loc='outside lower center', ncols=3)
    return figure


def _circular_figures(result: Circular) -> str:
    parts = [f'G {measure(result.G, digits=2)}']
    if result.G_b is not None:
        parts.append(f'G(b) {measure(result.G_b, digits=2)}')
    parts.append(f'F {measure(result.F_min, digits=2)} to {measure(result.F_max, digits=2)}')
    if result.H is not None:
        parts.append(f'H {measure(result.H, digits=2)}')
    return ', '.join(parts)
