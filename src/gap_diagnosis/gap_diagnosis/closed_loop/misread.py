"""A wave over the position that the tracker shows: the table's, or what the encoder reads?

Both make the same difference between tracker and encoder. But the loop follows the encoder: what
it reads falsely moves the table where the loop is fast enough, and shows in the encoder where it
is not. The wave of the table shows in the tracker alone.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from gap_diagnosis.closed_loop.channels import Channel
from gap_diagnosis.closed_loop.polish import LoopFit
from gap_diagnosis.closed_loop.replay import replay
from gap_diagnosis.input.data import Record
from gap_diagnosis.input.reading_wave import MISREADS
from gap_diagnosis.input.windows import judging, scored_ticks
from gap_diagnosis.parameters import Parameters, plain_values
from stage_core.quantities import split_effect
from stage_core.twin_file import TwinFile
from stage_twin.effects import EFFECTS, link_of
from stage_twin.effects.encoder_interpolation import LONGEST
from stage_twin.effects.periodic import OWN_TURN

#: Share of the squared gap. The right wave closed 0.35 of it beside a friction that was fitted
#: without it.
CLOSES = 0.2

TABLE = 'cyclic_pitch_error'


def misread(
    records: Sequence[Record],
    twin: TwinFile,
    parameters: Parameters,
    channels: Mapping[str, Channel],
    floors: Mapping[str, float],
) -> str | None:
    """A named wave of the table that the encoder's gap shows to be the encoder's, if there is one.

    It is, if the encoder reads a wave of that period already, or if the same wave read by it
    closes some of the squared gap above the floor that it is left with (`CLOSES`). The wave is not
    fitted: a wrong one adds to the gap. The forces of the axis are, as they were without it: a
    friction makes up for a wave, too.
    """
    effects = plain_values(parameters)
    for name, values in effects.items():
        effect, axis = split_effect(name)
        encoder = channels.get(f'encoder.{axis}')
        if effect != TABLE or encoder is None or axis is None or twin.kind != 'servo':
            continue
        wave = _read(values, twin.servo(axis).lead)
        if wave['period'] >= LONGEST:
            continue
        known = effects.get(f'{MISREADS}.{axis}')
        travel = max(float(np.ptp(r.encoder[:, r.column(axis)])) for r in records)
        if known and abs(travel / known['period'] - travel / wave['period']) < OWN_TURN:
            return name
        read = {f'{MISREADS}.{axis}': {k: (v, 0.0) for k, v in wave.items()}}
        rest = {n: v for n, v in parameters.items() if n != name}
        forces = {n: v for n, v in rest.items() if link_of(n) == 'servo' and n[-1] == axis}
        refitted = LoopFit(list(records), twin, axis, read).polish(forces) if forces else {}
        other = plain_values({**rest, **refitted, **read})
        gaps = [replay(r, twin, other)[encoder.name][scored_ticks(r)] for r in judging(records)]
        floor = floors[encoder.name] ** 2
        left = float(np.mean(np.concatenate(gaps) ** 2)) - floor
        if left < (1.0 - CLOSES) * (encoder.rms('after') ** 2 - floor):
            return name
    return None


def _read(values: Mapping[str, float], lead: float) -> dict[str, float]:
    """The wave with which the encoder reads what the table would have moved: half a turn away."""
    # A growth along the travel and waves of other periods are the table's alone.
    known = {k: v for k, v in values.items() if k in EFFECTS[MISREADS].defaults()}
    turned = {k: v + math.pi for k, v in known.items() if k.startswith('phase')}
    return {**known, **turned, 'period': values['period'] or lead}
