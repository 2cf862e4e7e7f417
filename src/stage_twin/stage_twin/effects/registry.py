"""Collects the effects: every module of this folder that defines `EFFECT`, and files from outside.

The order is that of the chain, within a link alphabetical.
"""

from __future__ import annotations

import os
import pkgutil
import sys
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from importlib import import_module
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType
from typing import Any

from stage_core.arrays import Array
from stage_core.errors import StageError
from stage_core.quantities import LINKS, split_effect
from stage_twin.effects.definition import Effect
from stage_twin.effects.term import Term


def _collect() -> dict[str, ModuleType]:
    names = [module.name for module in pkgutil.iter_modules([str(FOLDER)])]
    modules = [import_module(f'{__package__}.{name}') for name in names if name[0] != '_']
    modules += [_load(path) for path in EXTRA_FILES]
    found = [m for m in modules if isinstance(getattr(m, 'EFFECT', None), Effect)]
    found.sort(key=lambda m: (LINKS.index(m.EFFECT.link), m.EFFECT.name))
    return {module.EFFECT.name: module for module in found}


def _load(path: Path) -> ModuleType:
    spec = spec_from_file_location(f'{__package__}.{path.stem}', path)
    assert spec is not None and spec.loader is not None
    module = module_from_spec(spec)
    sys.modules[spec.name] = module
    try:
        spec.loader.exec_module(module)
    except OSError as error:
        raise StageError(
            f'{path} of {VARIABLE} cannot be read: name a file or a folder'
        ) from error
    return module


def _extra_files() -> list[Path]:
    given = [Path(name) for name in os.environ.get(VARIABLE, '').split(os.pathsep) if name]
    return [f for path in given for f in (sorted(path.glob('*.py')) if path.is_dir() else [path])]


#: Environment variable that names files of effects, or folders of such, beside the library's own.
VARIABLE = 'STAGE_EFFECTS'
FOLDER = Path(__file__).parent
EXTRA_FILES: list[Path] = _extra_files()
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


def misreads(name: str) -> bool:
    """Whether the encoder reads another position by this effect, with or without its axis."""
    return hasattr(MODULES[split_effect(name)[0]], 'read')


def seen_by_tracker(name: str) -> bool:
    """Whether a tracker may see the effect beside what the encoder reads, axis or not."""
    return link_of(name) != 'servo' or hasattr(MODULES[split_effect(name)[0]], 'table_term')


def terms(candidates: Mapping[str, Any]) -> dict[str, Term]:
    """What effects add to a residual; one that these rows cannot show is left out.

    Parameters
    ----------
    candidates
        Effect, with its axis where it has one -> the rows that it is asked for:
        :class:`~stage_twin.effects.rows.ForceRows` in the servo link,
        :class:`~stage_twin.effects.rows.TrackerRows` in the others.
    """
    return _made(candidates, 'term')


def table_terms(candidates: Mapping[str, Any]) -> dict[str, Term]:
    """What the tracker sees of effects of the servo link: `candidates` as for :func:`terms`."""
    return _made(candidates, 'table_term')


def _made(candidates: Mapping[str, Any], which: str) -> dict[str, Term]:
    modules = [(n, m) for n, m in _modules(candidates) if hasattr(m, which)]
    made = {name: getattr(module, which)(candidates[name]) for name, module in modules}
    return {name: term for name, term in made.items() if term is not None}


def signatures(candidates: Mapping[str, Any]) -> dict[str, Callable[[], Array]]:
    """For effects that are functions of one condition: a general basis (n, k) of that condition.

    `candidates` as for :func:`terms`.
    """
    return {
        n: partial(m.signature, candidates[n])
        for n, m in _modules(candidates)
        if hasattr(m, 'signature')
    }


def _modules(names: Iterable[str]) -> list[tuple[str, ModuleType]]:
    return [(name, MODULES[split_effect(name)[0]]) for name in names]


def held_by(name: str) -> tuple[str, ...]:
    """Names of the effects that this one has as special cases, on its axis."""
    return _on_axis(name, effect_of(name).holds)


def _on_axis(name: str, others: tuple[str, ...]) -> tuple[str, ...]:
    axis = split_effect(name)[1]
    return tuple(f'{other}.{axis}' for other in others)
