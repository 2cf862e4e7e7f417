"""Frequency response of the position loop, of the machine and of both twins."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from gap_diagnosis.closed_loop.channels import Channel
from gap_diagnosis.input.data import Record
from gap_diagnosis.input.windows import judging
from gap_diagnosis.report.figures import AFTER, BEFORE
from gap_diagnosis.result import Diagnosis
from stage_core.arrays import Array
from stage_core.drawing import canvas, plain, styled
from stage_core.theme import INK

#: Ticks of one stretch of a frequency response, and the coherence of reference and encoder from
#: which it is drawn: with eight stretches the magnitude is then known to about 12 %.
STRETCH, COHERENT = 1024, 0.8


@dataclass(frozen=True)
class Response:
    """Frequency response from reference to encoder of one axis; arrays (k,), complex."""

    axis: str
    frequency: Array
    machine: NDArray[np.complex128]
    nominal: NDArray[np.complex128]
    corrected: NDArray[np.complex128]


def responses(diagnosis: Diagnosis) -> list[Response]:
    """Response of the closed loop of each axis, as recorded and by both twins."""
    scored = judging(diagnosis.records)
    found = []
    for name, channel in diagnosis.channels.items():
        kind, _, axis = name.partition('.')
        if kind == 'encoder' and len(scored) == len(channel.time):
            response = _response(scored, channel, axis)
            if response is not None:
                found.append(response)
    return found


def _response(records: list[Record], channel: Channel, axis: str) -> Response | None:
    stretches = []
    for record, time, before, after in zip(
        records, channel.time, channel.before, channel.after, strict=True
    ):
        index = np.clip(np.searchsorted(record.time, time), 0, len(record.time) - 1)
        column = record.column(axis)
        encoder = record.encoder[index, column]
        rows = np.stack([record.reference[index, column], encoder, encoder - before,
                         encoder - after])  # fmt: skip
        cuts = np.flatnonzero(np.diff(index) > 1) + 1
        for part in np.split(rows, cuts, axis=1):
            starts = range(0, part.shape[1] - STRETCH, STRETCH // 2)
            stretches += [part[:, s : s + STRETCH + 1] for s in starts]
    if len(stretches) < 2:
        return None
    # Differences: a position that goes on rising has no spectrum of its own.
    moved = np.diff(np.array(stretches), axis=2) * np.hanning(STRETCH)
    spectrum = np.fft.rfft(moved, axis=2)[:, :, 1:]
    cross = (spectrum * spectrum[:, :1].conj()).mean(axis=0)
    power = (np.abs(spectrum) ** 2).mean(axis=0)
    coherence = np.abs(cross[1]) ** 2 / np.maximum(power[0] * power[1], 1e-300)
    low = np.flatnonzero(coherence < COHERENT)
    last = int(low[0]) if len(low) else len(coherence)
    if last < 4:
        return None
    ratio = cross[1:, :last] / power[0, :last]
    frequency = np.asarray(np.fft.rfftfreq(STRETCH, records[0].period)[1 : last + 1], np.float64)
    machine, nominal, corrected = np.asarray(ratio, np.complex128)
    return Response(axis, frequency, machine, nominal, corrected)


@styled
def response_plot(found: list[Response]) -> Figure:
    """Magnitude and phase of every axis, one column an axis."""
    figure = canvas(10.5, 4.8)
    panels = figure.subplots(2, len(found), squeeze=False, sharex='col')
    for (upper, lower), item in zip(panels.T, found, strict=True):
        curves = (
            (item.nominal, BEFORE),
            (item.corrected, AFTER),
            (item.machine, {'color': INK, 'lw': 1.1, 'ls': '--', 'label': 'machine'}),
        )
        for values, style in curves:
            upper.semilogx(item.frequency, 20.0 * np.log10(np.abs(values)), **style)
            lower.semilogx(item.frequency, np.degrees(np.unwrap(np.angle(values))), **style)
        plain(lower.xaxis)
        upper.set(title=f'axis {item.axis}', ylabel='magnitude (dB)')
        lower.set(xlabel='frequency (Hz)', ylabel='phase (°)')
    handles = panels[0, 0].get_legend_handles_labels()
    figure.legend(*handles, loc='outside upper center', ncols=3)
    return figure
