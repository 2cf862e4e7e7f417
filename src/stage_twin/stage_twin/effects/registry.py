"""Collects the effects: every module of this folder that defines `EFFECT`, and files from outside.

The order is that of the chain, within a link alphabetical.
"""

from __future__ import annotations

import pkgutil
from importlib import import_module
from pathlib import Path
from types import ModuleType

from stage_core.quantities import LINKS, split_effect
from stage_twin.effects.definition import Effect


def _collect() -> dict[str, ModuleType]:
    names = [module.name for module in pkgutil.iter_modules([str(Path(__file__).parent)])]
    modules = [import_module(f'{__package__}.{name}') for name in names if name[0] != '_']
    found = [m for m in modules if isinstance(getattr(m, 'EFFECT', None), Effect)]
    found.sort(key=lambda m: (LINKS.index(m.EFFECT.link), m.EFFECT.name))
    return {module.EFFECT.name: module for module in found}


#: Effect name -> module that holds all that is known of it.
MODULES: dict[str, ModuleType] = _collect()
#: Effect name -> definition.
EFFECTS: dict[str, Effect] = {name: module.EFFECT for name, module in MODULES.items()}


def effect_of(name: str) -> Effect:
    """Definition of a name with or without its axis; KeyError where there is none."""
    return EFFECTS[split_effect(name)[0]]


def link_of(name: str) -> str:
    """Link of the chain of an effect, named with or without its axis."""
    return effect_of(name).link


def held_by(name: str) -> tuple[str, ...]:
    """Names of the effects that this one has as special cases, on its axis."""
    return _on_axis(name, effect_of(name).holds)


def _on_axis(name: str, others: tuple[str, ...]) -> tuple[str, ...]:
    axis = split_effect(name)[1]
    return tuple(f'{other}.{axis}' for other in others)


def separating(one: str, other: str) -> str:
    """What to measure where two effects cannot be told apart: the object of "measure"."""
    first, second = effect_of(one), effect_of(other)
    known = first.separated_from.get(second.name) or second.separated_from.get(first.name)
    return known or f'{first.excited_by}, and {second.excited_by}'
