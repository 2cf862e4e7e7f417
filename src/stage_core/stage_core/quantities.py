"""Axes, links of the chain and how an effect is named (interfaces.md, "Effects")."""

from __future__ import annotations

AXES = ('x', 'y')

#: The chain from command to measurement, in the order in which a gap is searched.
LINKS = ('servo', 'kinematic', 'sensor')

UNKNOWN = 'unknown'

MICROMETRE = 1e-6


def split_effect(name: str) -> tuple[str, str | None]:
    """Split ``backlash.x`` into ``('backlash', 'x')``; without an axis the second is None."""
    effect, _, axis = name.partition('.')
    return effect, axis or None
