"""The wave that an encoder reads over its own position, as the loop follows it closest.

What the readings tell of the wave holds the loop's answer to it (`reading_wave`). The twin answers
as the machine does.
"""

from __future__ import annotations

from dataclasses import replace

from gap_diagnosis.closed_loop.axis_loop import AxisLoop
from gap_diagnosis.input.data import Record
from gap_diagnosis.residuals.reading import waves_read
from stage_core.quantities import split_effect
from stage_core.twin_file import TwinFile


def with_waves_of_loop(records: list[Record], twin: TwinFile) -> list[Record]:
    """The records, of which one that tells waves by itself has them refined in the loop."""
    told = waves_read(records, twin)
    if not told:
        return records
    waves = dict(records[0].waves)
    for name, wave in told.items():
        loop = AxisLoop(records, twin, str(split_effect(name)[1]))
        waves.update(loop.refined({name: wave}))
    return [replace(records[0], waves=waves)]
