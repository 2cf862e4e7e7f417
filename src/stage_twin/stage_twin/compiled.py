"""Compiles what depends on the effects, and keeps the code per state of the library.

A compiled loop allocates nothing: what it works in comes from its caller, and one that allocates
does not compile. So no row of an array that it looks at is counted, which would take three
quarters of a tick.

Numba's cache on disk knows a function by its own file only. What a kernel calls stands in other
files: the effects', and those that `STAGE_EFFECTS` names. So the cache has one folder per content
of all of them.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from numba import njit
from numba.core import config

from stage_twin.effects.registry import EXTRA_FILES

Function = TypeVar('Function', bound=Callable[..., Any])


def _state() -> str:
    """Hash of the sources that compiled functions of the twin may call."""
    package = Path(__file__).parent
    files = [*sorted(package.glob('*.py')), *sorted(package.glob('effects/*.py')), *EXTRA_FILES]
    text = b''.join(path.name.encode() + path.read_bytes() for path in files)
    return hashlib.sha1(text).hexdigest()[:12]


_STATE = _state()


def compiled(function: Function) -> Function:
    """`njit` without allocation, with a cache of its own for each state of the library of effects.

    Without NUMBA_CACHE_DIR these caches lie beside the sources; where nobody may write there, an
    effect from outside is compiled by each process.
    """
    outer, beside = config.CACHE_DIR, Path(__file__).parent / '__pycache__'
    if not outer and not os.access(beside, os.W_OK):
        return njit(cache=not EXTRA_FILES, _nrt=False)(function)  # type: ignore[no-any-return]
    config.CACHE_DIR = os.path.join(outer or beside, f'twin-{_STATE}')
    try:
        return njit(cache=True, _nrt=False)(function)  # type: ignore[no-any-return]
    finally:
        config.CACHE_DIR = outer
