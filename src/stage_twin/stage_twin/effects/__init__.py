"""The library of unmodelled effects: one definition per name of docs/interfaces.md, "Effects"."""

from __future__ import annotations

from stage_twin.effects.definition import Effect, EffectParameter
from stage_twin.effects.drive import DRIVE_EFFECTS
from stage_twin.effects.friction import FRICTION_EFFECTS
from stage_twin.effects.guide import GUIDE_EFFECTS
from stage_twin.effects.screw import SCREW_EFFECTS
from stage_twin.effects.sensor import SENSOR_EFFECTS
from stage_twin.effects.structure import STRUCTURE_EFFECTS

#: Effect name -> definition.
EFFECTS: dict[str, Effect] = {
    effect.name: effect
    for effect in (
        *FRICTION_EFFECTS,
        *DRIVE_EFFECTS,
        *STRUCTURE_EFFECTS,
        *SCREW_EFFECTS,
        *GUIDE_EFFECTS,
        *SENSOR_EFFECTS,
    )
}

__all__ = ['EFFECTS', 'Effect', 'EffectParameter']
