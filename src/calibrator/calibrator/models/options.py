"""Options of a method, checked before anything is fitted."""

from __future__ import annotations

import math
from collections.abc import Mapping
from numbers import Integral, Real
from typing import Any

from stage_core.errors import StageError
from stage_core.names import nearest

COUNTS = ('degree', 'rules', 'neurons', 'trees', 'models')
"""Options that are a whole number where they are not left to the data."""


def checked_options(method: str, given: Mapping[str, Any], defaults: Mapping[str, Any]) -> None:
    """Refuse options that a method does not know, and values of another kind than the default's.

    Raises
    ------
    StageError
        With the option's name, and what it has to be.
    """
    for name, value in given.items():
        if name not in defaults:
            meant = nearest(name, defaults) if defaults else 'it has none'
            raise StageError(f'method {method} has no option {name}: {meant}')
        wanted = _wanted(name, value, defaults[name])
        if wanted:
            raise StageError(f'option {name} of method {method} must be {wanted}, got {value!r}')


def _wanted(name: str, value: Any, default: Any) -> str:
    """What an option must be, where its value is not; else empty."""
    if name == 'lead':
        lengths = value if isinstance(value, list) else [value]
        ok = value in (None, 'search') or all(_number(length) for length in lengths)
        return '' if ok else 'a length per axis in m, "search" or null'
    if name == 'harmonics':
        ok = isinstance(value, list) and all(_whole(order, 1) for order in value)
        return '' if ok else 'a list of whole numbers'
    if isinstance(default, bool):
        return '' if isinstance(value, bool) else 'true or false'
    if isinstance(default, float):
        return '' if _number(value) else 'a number that is not negative'
    if name in COUNTS or isinstance(default, int):
        least = 0 if name == 'degree' or default == 0 else 1
        ok = _whole(value, least) or (default == 'auto' and value == 'auto')
        return '' if ok else f'a whole number, {least} or more' + _auto(default)
    return '' if isinstance(value, str) else 'a text'


def _auto(default: Any) -> str:
    return ', or "auto"' if default == 'auto' else ''


def _whole(value: Any, least: int) -> bool:
    return isinstance(value, Integral) and not isinstance(value, bool) and int(value) >= least


def _number(value: Any) -> bool:
    known = isinstance(value, Real) and not isinstance(value, bool)
    return known and math.isfinite(value) and float(value) >= 0.0
