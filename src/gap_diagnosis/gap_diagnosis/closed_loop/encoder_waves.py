"""Waves that encoders read over their own positions, and the motion behind them.

A loop follows what its encoder reads, so that the drive moves the axis by what it misreads: a
force balance of the readings would hold an acceleration that no force has made.

What the readings tell of the wave holds the loop's answer to it (`reading_wave`), and what a
tracker tells has the tracker's noise. The twin answers as the machine does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from gap_diagnosis.closed_loop.axis_loop import AxisLoop
from gap_diagnosis.evidence.describe import describe
from gap_diagnosis.input.data import Record
from gap_diagnosis.input.reading_wave import MISREADS
from gap_diagnosis.memory import Memory
from gap_diagnosis.parameters import Estimates, Parameters
from gap_diagnosis.selection.parts import Part
from stage_core.quantities import split_effect
from stage_core.twin_file import TwinFile


def waves_read(records: Sequence[Record], twin: TwinFile) -> Parameters:
    """Waves of the encoders as these show them by themselves, where the twin states none."""
    if twin.kind != 'servo' or len(records) > 1:
        return {}  # each session has a phase of its own
    return {name: wave for name, wave in records[0].waves.items() if name not in twin.effects}


def motion_beside(record: Record, axis: str) -> Record:
    """The record with the motion of an axis in the place of what its encoder reads."""
    encoder, column = record.encoder.copy(), record.column(axis)
    encoder[:, column] = record.motion(column)
    return replace(record, encoder=encoder)


def with_waves_of_loop(records: list[Record], twin: TwinFile) -> list[Record]:
    """The records, of which one that tells waves by itself has them refined in the loop."""
    told = waves_read(records, twin)
    return _refined(records, twin, told, {}, Memory()) if told else records


def with_waves_of_tracker(
    records: list[Record], twin: TwinFile, part: Part, known: Parameters, memory: Memory
) -> list[Record]:
    """The records with the waves that a part tells of their encoders.

    That of one record is refined in the loop beside what is `known`. Each of several has a phase
    of its own.
    """
    found = describe(part.selection, part.selector.regression)
    told = {n: wave for n, wave in found.items() if split_effect(n)[0] == MISREADS}
    if len(records) == 1:
        return _refined(records, twin, told, known, memory)
    return [
        replace(r, waves={**r.waves, **{n: _of_session(part, n, i, w) for n, w in told.items()}})
        for i, r in enumerate(records)
    ]


def _refined(
    records: list[Record], twin: TwinFile, told: Parameters, known: Parameters, memory: Memory
) -> list[Record]:
    """One record with its waves as the loop tells them."""
    waves = dict(records[0].waves)
    for name, wave in told.items():
        beside = {n: v for n, v in known.items() if n != name}
        loop = AxisLoop(records, twin, str(split_effect(name)[1]), beside, memory)
        waves.update(loop.refined({name: wave}))
    return [replace(records[0], waves=waves)]


def _of_session(part: Part, name: str, number: int, wave: Estimates) -> Estimates:
    """The wave as one of several sessions has it."""
    fit = part.selection.fit
    own = fit.sessions.get(number, {}).get(name)
    if own is None:
        return wave
    values = part.problem.terms[name].parameters(fit.thetas[name], own)
    return {key: (values.get(key, value), std) for key, (value, std) in wave.items()}
