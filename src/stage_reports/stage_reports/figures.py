"""Pictures of error maps, positioning tests, circular tests, learning and signals.

Every function takes SI arrays and returns a matplotlib ``Figure`` drawn without pyplot, so that
nothing depends on a display or on global state. Deviations are drawn in micrometres.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray
from scipy import signal

from stage_core.errors import StageError
from stage_reports.iso230 import Circular, Positioning

Array = NDArray[np.float64]
MICRO = 1e6
MILLI = 1e3
#: Colours that stay apart for the colour-blind (Okabe and Ito).
BLUE, ORANGE, GREEN, GREY = '#0072B2', '#D55E00', '#009E73', '#777777'
COLOURS = (BLUE, ORANGE, GREEN, '#CC79A7', '#E69F00', '#56B4E9')
MAXIMUM_POINTS = 20000


def _pairs(name: str, values: ArrayLike) -> Array:
    table = np.asarray(values, dtype=float)
    if table.ndim != 2 or table.shape[1] != 2 or not np.isfinite(table).all():
        raise StageError(f'{name} of shape {table.shape}: give finite numbers (n, 2) in metres')
    return table


def _thin(count: int, limit: int) -> Array:
    """Indices that leave at most ``limit`` of ``count`` samples, evenly."""
    return np.unique(np.linspace(0, count - 1, min(count, limit)).astype(int))


def error_map(
    points: ArrayLike, before: ArrayLike, after: ArrayLike | None = None, arrows: int = 400
) -> Figure:
    """Errors as arrows over the workspace, uncorrected and, where given, corrected.

    Both maps share one scale, written on the arrow of the key.

    Parameters
    ----------
    points : (n, 2) nominal positions, m. before, after : (n, 2) errors there, m.
    """
    places = _pairs('points', points)
    first = 'errors' if after is None else 'before'
    maps = [(first, _pairs('errors before', before), ORANGE)]
    if after is not None:
        maps.append(('after', _pairs('errors after', after), BLUE))
    if any(values.shape != places.shape for _, values, _ in maps):
        raise StageError('an error map needs one error for each point')
    index = _thin(len(places), arrows)
    longest = max(float(np.linalg.norm(values, axis=1).max()) for _, values, _ in maps)
    span = float(np.ptp(places, axis=0).max()) or 1.0
    # The longest arrow spans a tenth of the workspace.
    scale = max(longest, np.finfo(float).tiny) * MICRO / (0.1 * span * MILLI)
    figure = Figure(figsize=(5.6 * len(maps), 5.4), layout='constrained')
    for axes, (name, values, colour) in zip(
        np.atleast_1d(figure.subplots(1, len(maps))), maps, strict=True
    ):
        arrow = axes.quiver(
            places[index, 0] * MILLI,
            places[index, 1] * MILLI,
            values[index, 0] * MICRO,
            values[index, 1] * MICRO,
            angles='xy',
            scale_units='xy',
            scale=scale,
            color=colour,
            width=0.003,
        )
        axes.quiverkey(
            arrow, 0.68, 1.03, longest * MICRO, f'{longest * MICRO:.3g} µm', labelpos='E'
        )
        rms = float(np.sqrt((values**2).sum(axis=1).mean())) * MICRO
        axes.set_title(f'{name}: RMS {rms:.3g} µm', loc='left')
        axes.set(xlabel='x (mm)', ylabel='y (mm)')
        axes.set_aspect('equal', adjustable='datalim')
        axes.margins(0.12)
    return figure


def positioning_plot(result: Positioning, axis_name: str = '') -> Figure:
    """Positioning deviations over the targets as ISO 230-2 draws them: means and +-2 s."""
    figure = Figure(figsize=(8.0, 4.6), layout='constrained')
    axes = figure.subplots()
    position = result.targets * MILLI
    for name, mean, s, colour, marker in (
        ('positive approach', result.mean_up, result.deviation_up, BLUE, '^'),
        ('negative approach', result.mean_down, result.deviation_down, ORANGE, 'v'),
    ):
        axes.errorbar(
            position,
            mean * MICRO,
            yerr=2.0 * s * MICRO,
            color=colour,
            marker=marker,
            capsize=3,
            label=f'{name}, mean ± 2 s',
        )
    axes.plot(position, result.mean * MICRO, color=GREY, ls='--', label='bidirectional mean')
    figures = ', '.join(
        f'{name} {getattr(result, name) * MICRO:.3g}' for name in ('A', 'R', 'B', 'E', 'M')
    )
    axes.set(
        title=f'ISO 230-2 {axis_name}: {figures} µm'.replace('  ', ' '),
        xlabel='target position (mm)',
        ylabel='deviation (µm)',
    )
    axes.grid(alpha=0.3)
    axes.legend()
    return figure


def circular_plot(
    result: Circular, counter_clockwise: ArrayLike, clockwise: ArrayLike | None = None
) -> Figure:
    """Radial deviations over the angle, magnified about the nominal circle (ISO 230-4)."""
    figure = Figure(figsize=(6.4, 6.4), layout='constrained')
    axes = figure.add_subplot(projection='polar')
    paths = [('counter-clockwise', _pairs('path', counter_clockwise), BLUE)]
    if clockwise is not None:
        paths.append(('clockwise', _pairs('path', clockwise), ORANGE))
    widest = max(abs(result.F_max), abs(result.F_min), np.finfo(float).tiny) * MICRO
    for name, path, colour in paths:
        offset = path[_thin(len(path), MAXIMUM_POINTS)] - result.centre
        deviation = np.linalg.norm(offset, axis=1) - result.radius
        axes.plot(
            np.arctan2(offset[:, 1], offset[:, 0]),
            deviation * MICRO,
            color=colour,
            lw=0.9,
            marker='.',
            ms=1.5,
            ls='none' if len(offset) > 2000 else '-',
            label=name,
        )
    turn = np.linspace(0.0, 2.0 * np.pi, 181)
    axes.plot(turn, np.zeros_like(turn), color=GREY, lw=0.8, label='nominal')
    axes.set_ylim(-3.0 * widest, 1.5 * widest)
    parts = [f'G {result.G * MICRO:.3g}']
    if result.G_b is not None:
        parts.append(f'G(b) {result.G_b * MICRO:.3g}')
    parts.append(f'F {result.F_min * MICRO:.3g} .. {result.F_max * MICRO:.3g}')
    if result.H is not None:
        parts.append(f'H {result.H * MICRO:.3g}')
    axes.set_title(
        f'ISO 230-4, radius {result.radius * MILLI:.4g} mm: {", ".join(parts)} µm', fontsize=10
    )
    axes.legend(loc='lower right', fontsize=8)
    return figure


def convergence(errors: Mapping[str, ArrayLike], title: str = 'learning') -> Figure:
    """Errors over the trials of iterative learning, metres, on a logarithmic axis.

    Parameters
    ----------
    errors : name of a figure (RMS, maximum, a scheme) -> its value in each trial (n,), m.
    """
    if not errors:
        raise StageError('no learning curve given: pass at least one list of errors')
    figure = Figure(figsize=(7.0, 4.2), layout='constrained')
    axes = figure.subplots()
    for colour, (name, values) in zip(
        np.resize(COLOURS, len(errors)), errors.items(), strict=True
    ):
        curve = np.asarray(values, dtype=float)
        axes.plot(
            np.arange(1, curve.size + 1), curve * MICRO, marker='o', color=str(colour), label=name
        )
    axes.set(title=title, xlabel='trial', ylabel='error (µm)', yscale='log')
    axes.xaxis.get_major_locator().set_params(integer=True)
    axes.grid(alpha=0.3, which='both')
    axes.legend()
    return figure


def learning_rate(values: Mapping[str, ArrayLike], title: str = 'learning rate') -> Figure:
    """Factors without unit over the trials: learning rates, reinforcement signals.

    Parameters
    ----------
    values : name of a factor -> its value in each trial (n,).
    """
    if not values:
        raise StageError('no learning rate given: pass at least one list')
    figure = Figure(figsize=(7.0, 4.2), layout='constrained')
    axes = figure.subplots()
    for colour, (name, curve) in zip(np.resize(COLOURS, len(values)), values.items(), strict=True):
        data = np.asarray(curve, dtype=float)
        axes.step(
            np.arange(1, data.size + 1),
            data,
            where='mid',
            marker='o',
            color=str(colour),
            label=name,
        )
    axes.set(title=title, xlabel='trial', ylabel='factor')
    axes.xaxis.get_major_locator().set_params(integer=True)
    axes.grid(alpha=0.3)
    axes.legend()
    return figure


def time_series(
    seconds: ArrayLike, values: Mapping[str, ArrayLike], unit: str, title: str = ''
) -> Figure:
    """Signals over time; each name a curve, all in the unit given (already scaled)."""
    time = np.asarray(seconds, dtype=float)
    figure = Figure(figsize=(8.4, 3.6), layout='constrained')
    axes = figure.subplots()
    index = _thin(time.size, MAXIMUM_POINTS)
    for colour, (name, curve) in zip(np.resize(COLOURS, len(values)), values.items(), strict=True):
        data = np.asarray(curve, dtype=float)
        if data.shape != time.shape:
            raise StageError(f'{name} has {data.size} samples over {time.size} times: align them')
        axes.plot(time[index], data[index], lw=0.8, color=str(colour), label=name)
    axes.set(title=title, xlabel='time (s)', ylabel=unit)
    axes.grid(alpha=0.3)
    axes.legend()
    return figure


def spectrum(values: Mapping[str, ArrayLike], rate: float, unit: str, title: str = '') -> Figure:
    """Amplitude spectral density (Welch, Hann) of signals sampled at ``rate`` Hz."""
    if not rate > 0.0:
        raise StageError(f'the sampling rate {rate} Hz must be positive')
    figure = Figure(figsize=(8.4, 3.6), layout='constrained')
    axes = figure.subplots()
    for colour, (name, curve) in zip(np.resize(COLOURS, len(values)), values.items(), strict=True):
        data = np.asarray(curve, dtype=float)
        if data.size < 8:
            raise StageError(f'{name} has {data.size} samples: a spectrum needs at least 8')
        frequency, density = signal.welch(data, rate, nperseg=min(data.size, 4096))
        axes.loglog(frequency[1:], np.sqrt(density[1:]), lw=0.8, color=str(colour), label=name)
    axes.set(title=title, xlabel='frequency (Hz)', ylabel=f'{unit}/√Hz')
    axes.grid(alpha=0.3, which='both')
    axes.legend()
    return figure


def path_plot(paths: Sequence[tuple[str, ArrayLike]], title: str = '') -> Figure:
    """Paths in the plane, (name, points (n, 2) in m), with equal axes."""
    figure = Figure(figsize=(6.0, 5.6), layout='constrained')
    axes = figure.subplots()
    for colour, (name, values) in zip(np.resize(COLOURS, len(paths)), paths, strict=True):
        points = _pairs(name, values)
        points = points[_thin(len(points), MAXIMUM_POINTS)] * MILLI
        axes.plot(points[:, 0], points[:, 1], lw=0.9, color=str(colour), label=name)
    axes.set(title=title, xlabel='x (mm)', ylabel='y (mm)')
    axes.set_aspect('equal', adjustable='datalim')
    axes.grid(alpha=0.3)
    axes.legend()
    return figure
