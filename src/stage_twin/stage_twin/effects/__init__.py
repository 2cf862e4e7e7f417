"""The library of unmodelled effects: one file holds all that is known of one."""

from stage_twin.effects.definition import Effect, Parameter
from stage_twin.effects.registry import (
    EFFECTS,
    effect_of,
    held_by,
    link_of,
    misreads,
    seen_by_tracker,
    signatures,
    table_terms,
    terms,
)

__all__ = [
    'EFFECTS',
    'Effect',
    'Parameter',
    'effect_of',
    'held_by',
    'link_of',
    'misreads',
    'seen_by_tracker',
    'signatures',
    'table_terms',
    'terms',
]
