"""What a session without recorded forces cannot tell, and how sure the rest is."""

from __future__ import annotations

import math

import numpy as np

from gap_diagnosis.input.data import Record
from gap_diagnosis.parameters import Parameters
from gap_diagnosis.residuals.drive_law import DriveLaw
from stage_twin.effects import EFFECTS, effect_of

#: What only a recorded force tells, and why.
NOT_TOLD = {n: effect.needs_effort for n, effect in EFFECTS.items() if effect.needs_effort}


def lost_drive(records: list[Record]) -> str:
    """Why no law of a drive was found, and what the commands lack beside the effort."""
    heard = all(np.isfinite(r.velocity_command).all() for r in records)
    lacking = '' if heard else ' (the velocity commands are missing, too)'
    return f'no gains of a controller and no single effect explain how it moves{lacking}'


def widened(found: Parameters, law: DriveLaw) -> Parameters:
    """Parameters whose deviations hold that of the force that they were read from."""
    out: Parameters = {}
    for name, values in found.items():
        scaling = {p.name for p in effect_of(name).parameters if p.unit.startswith('N')}
        out[name] = {
            k: (v, math.hypot(std, law.deviation * v) if k in scaling else std)
            for k, (v, std) in values.items()
        }
    return out
