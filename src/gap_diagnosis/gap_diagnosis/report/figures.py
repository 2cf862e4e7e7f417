"""Pictures of the diagnosis: the gap over time, its spectra, where it lies, and its conditions."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from gap_diagnosis.closed_loop.channels import Channel
from gap_diagnosis.report.words import condition_words
from gap_diagnosis.result import Diagnosis
from stage_core.arrays import Array
from stage_core.drawing import canvas, envelope, legend_above, paired, plain, styled
from stage_core.theme import BLUE, MUTED, ORANGE, RULE
from stage_core.wording import effect_words

#: The pale wide line below and the thin one above: where both agree, both are seen.
BEFORE = {'color': ORANGE, 'lw': 2.2, 'alpha': 0.65, 'label': 'nominal twin'}
AFTER = {'color': BLUE, 'lw': 0.9, 'label': 'corrected twin'}


def scale(channel: Channel) -> tuple[float, str]:
    """Factor and unit in which a channel is shown."""
    return (1.0, 'N') if channel.unit == 'N' else (1e6, 'µm')


def _joined(channel: Channel) -> tuple[Array, list[float]]:
    """Time with the stretches between the windows left out (n,) [s], and where windows begin."""
    starts, parts, begin = [], [], 0.0
    for time in channel.time:
        period = float(np.median(np.diff(time))) if len(time) > 1 else 0.0
        steps = np.diff(time, prepend=time[:1])
        jumps = steps > 20.0 * period
        steps[jumps] = period
        part = begin + np.cumsum(steps)
        starts += [float(part[0]), *part[jumps].tolist()]
        parts.append(part)
        begin = float(part[-1]) + period
    return np.concatenate(parts), starts


@styled
def time_series(diagnosis: Diagnosis) -> Figure:
    """Gap before and after over the held-out windows put together, one row per channel."""
    channels = list(diagnosis.channels.values())
    figure = canvas(10.5, 1.7 * len(channels) + 0.7)
    rows = figure.subplots(len(channels), 1, sharex=True, squeeze=False)[:, 0]
    for plot, channel in zip(rows, channels, strict=True):
        factor, unit = scale(channel)
        time, starts = _joined(channel)
        for values, style in ((channel.before, BEFORE), (channel.after, AFTER)):
            gap = factor * np.concatenate(values)
            index = envelope(gap, 1200)
            plot.plot(time[index], gap[index], **style)
        for start in starts[1:]:
            plot.axvline(start, color=MUTED, lw=0.8, ls=':')
        plot.set_ylabel(f'{effect_words(channel.name)} ({unit})')
        plot.margins(x=0.005)
    legend_above(figure, rows[0], 2)
    rows[-1].set_xlabel('time in the held-out windows, put together (s)')
    return figure


@styled
def spectra(diagnosis: Diagnosis) -> Figure:
    """Amplitude spectra of the gap before and after, one panel per channel."""
    channels = list(diagnosis.channels.values())
    figure, panels = paired(len(channels), 2.5)
    for plot, channel in zip(panels, channels, strict=True):
        factor, unit = scale(channel)
        period = float(np.median(np.diff(channel.time[0])))
        for values, style in ((channel.before, BEFORE), (channel.after, AFTER)):
            gap = factor * np.concatenate(values)
            size = min(len(gap), 4096)
            pieces = gap[: len(gap) // size * size].reshape(-1, size) * np.hanning(size)
            amplitude = np.sqrt(np.mean(np.abs(np.fft.rfft(pieces, axis=1)) ** 2, axis=0))
            frequency = np.fft.rfftfreq(size, period)
            # A gap of exactly zero has no place on a logarithmic axis.
            amplitude = np.maximum(4.0 / size * amplitude[1:], 1e-6)
            # On a logarithmic axis the first lines lie far apart: each of them is drawn.
            index = np.union1d(np.arange(min(40, len(amplitude))), envelope(amplitude, 400))
            plot.loglog(frequency[1:][index], amplitude[index], **style)
        plain(plot.xaxis)
        plot.set(xlabel='frequency (Hz)', ylabel=f'{effect_words(channel.name)} ({unit})')
    panels[0].legend()
    return figure


@styled
def heat_map(diagnosis: Diagnosis) -> Figure:
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
        label = 'y (mm)'
    else:
        second = 1e3 * np.gradient(first, time)
        label = f'speed of {record.axes[0]} (mm/s)'
    figure = canvas(10.5, 4.2)
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
        plot.set(title=f'{kind} gap {title}', xlabel=f'{record.axes[0]} (mm)', ylabel=label)
        plot.tick_params(labelleft=True)
    figure.colorbar(image, ax=panels, label='RMS gap (µm)')
    return figure


@styled
def shares(diagnosis: Diagnosis) -> Figure:
    """Share of the gap by condition, the significant ones in colour."""
    # A bar below half a per cent cannot be seen.
    found = [c for c in diagnosis.conditions if c.share >= 0.005][:12][::-1]
    figure = canvas(10.5, 0.42 * max(len(found), 3) + 0.9)
    plot = figure.subplots()
    # Two lines leave room for the bars on a phone.
    labels = [condition_words(c).replace(' (', '\n(') for c in found]
    colours = [BLUE if c.p_value < 0.05 else RULE for c in found]
    plot.barh(labels, [100.0 * c.share for c in found], color=colours)
    plot.set_xlim(0.0, 100.0)
    plot.set_xlabel('share of the gap (%)')
    return figure
