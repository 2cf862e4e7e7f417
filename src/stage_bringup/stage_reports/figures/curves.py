"""Pictures of signals and of errors over trials: curves, spectra, histograms."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator
from numpy.typing import ArrayLike
from scipy import signal

from stage_core.arrays import Array
from stage_core.drawing import canvas, colours, envelope, legend_above, plain, styled
from stage_core.errors import StageError
from stage_core.quantities import MICROMETRE
from stage_core.wording import measure, scaled


@styled
def convergence(errors: Mapping[str, ArrayLike], each: str = 'run') -> Figure:
    """Errors over the trials of iterative learning, metres, on a logarithmic axis.

    Parameters
    ----------
    errors : name of a figure (RMS, maximum, a scheme) -> its value in each trial (n,), m.
    each : what a trial is called.
    """
    if not errors:
        raise StageError('no learning curve given: pass at least one list of errors')
    figure = canvas(5.6, 4.2)
    axes = figure.subplots()
    curves = {name: np.asarray(values, dtype=float) for name, values in errors.items()}
    factor, unit = scaled(max(float(curve.max()) for curve in curves.values()), 'm')
    for colour, (name, curve) in zip(colours(len(curves)), curves.items(), strict=True):
        axes.plot(
            np.arange(1, curve.size + 1), curve * factor, marker='o', color=colour, label=name
        )
    axes.set(xlabel=each, ylabel=f'error ({unit})', yscale='log')
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    plain(axes.yaxis)
    axes.xaxis.get_major_locator().set_params(integer=True)
    axes.legend()
    return figure


@styled
def time_series(seconds: ArrayLike, values: Mapping[str, ArrayLike], unit: str) -> Figure:
    """Signals over time; each name a curve, all in the unit given (already scaled)."""
    time = np.asarray(seconds, dtype=float)
    figure = canvas(10.5, 3.4)
    axes = figure.subplots()
    for colour, (name, curve) in zip(colours(len(values)), values.items(), strict=True):
        data = np.asarray(curve, dtype=float)
        if data.shape != time.shape:
            raise StageError(f'{name} has {data.size} samples over {time.size} times: align them')
        index = envelope(data)
        axes.plot(time[index], data[index], lw=0.9, color=colour, label=name)
    axes.set(xlabel='time (s)', ylabel=unit)
    axes.margins(x=0.01)
    axes.legend(ncols=len(values))
    return figure


@styled
def deviation_over_time(
    measured: Sequence[tuple[str, Array, Array]], axes: Sequence[str]
) -> Figure:
    """Deviations from the reference over time, a panel an axis, each in the unit of its size.

    Parameters
    ----------
    measured : sensor, its times (n,) s, and measured minus reference (n, axes) m.
    axes : their names.
    """
    figure = canvas(10.5, 2.4 * len(axes) + 0.6)
    panels = figure.subplots(len(axes), 1, sharex=True, squeeze=False)[:, 0]
    for column, (name, panel) in enumerate(zip(axes, panels, strict=True)):
        widest = max(float(np.abs(deviation[:, column]).max()) for _, _, deviation in measured)
        factor, unit = scaled(widest, 'm')
        hues = colours(len(measured))
        for number, (sensor, seconds, deviation) in enumerate(measured):
            curve = deviation[:, column] * factor
            index = envelope(curve)
            # The first on top: an encoder has less noise than a tracker.
            panel.plot(
                seconds[index],
                curve[index],
                lw=0.9,
                color=next(hues),
                label=sensor,
                zorder=3.0 - 0.1 * number,
            )
        panel.set(ylabel=f'{name} − reference ({unit})')
        panel.margins(x=0.01)
    panels[-1].set(xlabel='time (s)')
    legend_above(figure, panels[0], len(measured))
    return figure


@styled
def spectrum(values: Mapping[str, ArrayLike], rate: float, unit: str) -> Figure:
    """Amplitude spectral density (Welch, Hann) of signals sampled at ``rate`` Hz."""
    if not rate > 0.0:
        raise StageError(f'the sampling rate {rate} Hz must be positive')
    figure = canvas(5.6, 4.2)
    axes = figure.subplots()
    for colour, (name, curve) in zip(colours(len(values)), values.items(), strict=True):
        data = np.asarray(curve, dtype=float)
        if data.size < 8:
            raise StageError(f'{name} has {data.size} samples: a spectrum needs at least 8')
        frequency, density = signal.welch(data, rate, nperseg=min(data.size, 4096))
        axes.loglog(frequency[1:], np.sqrt(density[1:]), lw=0.9, color=colour, label=name)
    plain(axes.xaxis)
    axes.set(xlabel='frequency (Hz)', ylabel=f'{unit}/√Hz')
    axes.legend()
    return figure


@styled
def histogram(values: Mapping[str, ArrayLike], rare: bool = False) -> Figure:
    """How often which error occurs; each name a set of errors in metres, with its RMS.

    `rare` takes a logarithmic share, which shows what happens seldom.
    """
    data = {name: np.asarray(v, dtype=float).ravel() for name, v in values.items()}
    if not data or any(v.size < 2 for v in data.values()):
        raise StageError('a histogram needs two errors or more of each name')
    figure = canvas(5.6, 4.2)
    axes = figure.subplots()
    widest = max(float(np.abs(v).max()) for v in data.values()) or MICROMETRE
    factor, unit = scaled(widest, 'm')
    smallest = min(v.size for v in data.values())
    edges = factor * np.linspace(-widest, widest, int(np.clip(np.sqrt(smallest) * 1.5, 8, 60)) | 1)
    for colour, (name, errors) in zip(colours(len(data)), data.items(), strict=True):
        share = np.full(errors.size, 100.0 / errors.size)
        rms = float(np.sqrt(np.mean(errors**2)))
        label = f'{name}: RMS {measure(rms)}'
        axes.hist(factor * errors, edges, weights=share, color=colour, alpha=0.22)
        axes.hist(
            factor * errors, edges, weights=share, color=colour, histtype='step', label=label
        )
    axes.set(xlabel=f'error ({unit})', ylabel='share (%)', yscale='log' if rare else 'linear')
    if rare:
        plain(axes.yaxis)
    axes.legend()
    return figure
