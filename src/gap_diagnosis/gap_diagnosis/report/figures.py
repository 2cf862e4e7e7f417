"""Pictures of the report, as PNG in data URIs."""

from __future__ import annotations

import base64
import io

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from gap_diagnosis.diagnose import Channel, Diagnosis

Array = NDArray[np.float64]

BEFORE, AFTER = '#c0392b', '#1f77b4'
MOST_POINTS = 3000


def data_uri(figure: Figure) -> str:
    """PNG of a figure as a data URI."""
    buffer = io.BytesIO()
    FigureCanvasAgg(figure)
    # No date in the file: the same diagnosis makes the same page.
    figure.savefig(buffer, format='png', dpi=90, metadata={'Software': None})
    return 'data:image/png;base64,' + base64.b64encode(buffer.getvalue()).decode('ascii')


def _scale(channel: Channel) -> tuple[float, str]:
    return (1.0, 'N') if channel.unit == 'N' else (1e6, 'µm')


def time_series(diagnosis: Diagnosis) -> str:
    """Gap before and after over the held-out windows, one row per channel."""
    channels = list(diagnosis.channels.values())
    figure = Figure(figsize=(9.5, 1.7 * len(channels) + 0.6), layout='constrained')
    rows = figure.subplots(len(channels), 1, sharex=True, squeeze=False)[:, 0]
    for plot, channel in zip(rows, channels, strict=True):
        factor, unit = _scale(channel)
        time = np.concatenate(channel.time)
        step = max(1, len(time) // MOST_POINTS)
        for values, colour, label in (
            (channel.before, BEFORE, 'nominal twin'),
            (channel.after, AFTER, 'corrected twin'),
        ):
            gap = factor * np.concatenate(values)
            plot.plot(time[::step], gap[::step], '.', color=colour, markersize=1.5, label=label)
        plot.set_ylabel(f'{channel.name} [{unit}]')
        plot.grid(alpha=0.3)
    rows[0].legend(loc='upper right', markerscale=5)
    rows[-1].set_xlabel('time in the held-out windows [s]')
    return data_uri(figure)


def spectra(diagnosis: Diagnosis) -> str:
    """Amplitude spectra of the gap before and after, one panel per channel."""
    channels = list(diagnosis.channels.values())
    figure = Figure(figsize=(9.5, 2.4 * ((len(channels) + 1) // 2) + 0.4), layout='constrained')
    panels = figure.subplots((len(channels) + 1) // 2, 2, squeeze=False).ravel()
    for plot, channel in zip(panels, channels, strict=False):
        factor, unit = _scale(channel)
        period = float(np.median(np.diff(channel.time[0])))
        for values, colour in ((channel.before, BEFORE), (channel.after, AFTER)):
            gap = factor * np.concatenate(values)
            size = min(len(gap), 4096)
            pieces = gap[: len(gap) // size * size].reshape(-1, size) * np.hanning(size)
            amplitude = np.sqrt(np.mean(np.abs(np.fft.rfft(pieces, axis=1)) ** 2, axis=0))
            frequency = np.fft.rfftfreq(size, period)
            # A gap of exactly zero has no place on a logarithmic axis.
            amplitude = np.maximum(4.0 / size * amplitude[1:], 1e-6)
            plot.loglog(frequency[1:], amplitude, color=colour, lw=0.8)
        plot.set_title(channel.name, fontsize=9)
        plot.set_xlabel('frequency [Hz]')
        plot.set_ylabel(f'amplitude [{unit}]')
        plot.grid(alpha=0.3)
    for plot in panels[len(channels) :]:
        plot.set_axis_off()
    return data_uri(figure)


def heat_map(diagnosis: Diagnosis) -> str:
    """RMS gap over the workspace, before and after: over x and y, or position and speed."""
    record = diagnosis.records[-1]
    channels = [c for c in diagnosis.channels.values() if c.unit == 'm']
    kind = 'tracker' if any(c.name.startswith('tracker') for c in channels) else 'encoder'
    chosen = [c for c in channels if c.name.startswith(kind)]
    time = chosen[0].time[-1]
    before = np.sqrt(sum(c.before[-1] ** 2 for c in chosen))
    after = np.sqrt(sum(c.after[-1] ** 2 for c in chosen))
    first = np.interp(time, record.time, record.encoder[:, 0])
    if len(record.axes) == 2:
        second = 1e3 * np.interp(time, record.time, record.encoder[:, 1])
        label = 'y [mm]'
    else:
        second = 1e3 * np.gradient(first, time)
        label = f'speed of {record.axes[0]} [mm/s]'
    figure = Figure(figsize=(9.5, 3.8), layout='constrained')
    panels = figure.subplots(1, 2, sharex=True, sharey=True)
    top = 1e6 * float(np.percentile(before, 99.0)) or 1.0
    image = None
    for plot, gap, title in zip(panels, (before, after), ('before', 'after'), strict=True):
        image = plot.hexbin(
            1e3 * first,
            second,
            C=1e12 * gap**2,
            reduce_C_function=lambda v: float(np.sqrt(np.mean(v))),
            gridsize=22,
            vmin=0.0,
            vmax=top,
            cmap='viridis',
        )
        plot.set_title(f'{kind} gap {title}')
        plot.set_xlabel(f'{record.axes[0]} [mm]')
    panels[0].set_ylabel(label)
    figure.colorbar(image, ax=panels, label='RMS gap [µm]')
    return data_uri(figure)


def shares(diagnosis: Diagnosis) -> str:
    """Share of the gap by condition, the significant ones in colour."""
    found = diagnosis.conditions[:12]
    figure = Figure(figsize=(9.5, 0.28 * max(len(found), 3) + 0.9), layout='constrained')
    plot = figure.subplots()
    labels = [f'{c.name} {c.axis} ({c.link})' for c in found][::-1]
    colours = [BEFORE if c.p_value < 0.05 else '#bbbbbb' for c in found][::-1]
    plot.barh(labels, [c.share for c in found][::-1], color=colours)
    plot.set_xlim(0.0, 1.0)
    plot.set_xlabel('share of the gap that goes with the condition (red: p < 0.05)')
    return data_uri(figure)
