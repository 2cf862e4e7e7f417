"""Pictures of error maps, standard tests, contours, learning and signals.

Every function takes SI arrays and returns a matplotlib ``Figure`` drawn without pyplot, so that
nothing depends on a display or on global state. Deviations are drawn in µm, mm or m, as their size
asks for.
"""

from stage_reports.figures.contours import contour_polar, error_over_path
from stage_reports.figures.curves import (
    convergence,
    deviation_over_time,
    histogram,
    spectrum,
    time_series,
)
from stage_reports.figures.hysteresis import hysteresis_loops
from stage_reports.figures.maps import error_map, error_over_axis, path_plot
from stage_reports.figures.standards import circular_plot, positioning_plot

__all__ = [
    'circular_plot',
    'contour_polar',
    'convergence',
    'deviation_over_time',
    'error_map',
    'error_over_axis',
    'error_over_path',
    'histogram',
    'hysteresis_loops',
    'path_plot',
    'positioning_plot',
    'spectrum',
    'time_series',
]
