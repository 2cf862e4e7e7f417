"""The motion behind an encoder that misreads: what a force balance has to be judged on.

The loop follows what the encoder reads, so that the drive moves the axis by what it misreads. A
force balance of the readings would hold an acceleration that no force has made.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from gap_diagnosis.input.data import Record
from gap_diagnosis.parameters import Parameters
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
