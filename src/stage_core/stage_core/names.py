"""A name that nobody knows: which known one was meant."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping
from typing import Any

from stage_core.errors import StageError


def nearest(name: str, known: Iterable[str]) -> str:
    """Which of the known names are close to an unknown one, as a sentence; else all of them."""
    names = sorted(known)
    # A name without its group is meant as often as a mistyped one: position_gain, x.position_gain.
    close = [other for other in names if other.rpartition('.')[2] == name]
    close += difflib.get_close_matches(name, names, n=3, cutoff=0.6)
    if close:
        return f'did you mean {" or ".join(dict.fromkeys(close))}?'
    return f'known are {", ".join(names)}'


def refuse_unknown_keys(
    content: Mapping[Any, Any], known: Iterable[str], where: str, before: str = ''
) -> None:
    """Check the keys of a mapping from a file.

    Parameters
    ----------
    content, known
        The mapping, and the keys that it may have.
    where, before
        The file, and the path of the mapping within it, as ``axes.x.``.

    Raises
    ------
    StageError
        For a key that is not known; the message holds the nearest known one.
    """
    names = list(known)
    for key in content:
        if key not in names:
            raise StageError(
                f'{where}: the key {before}{key} is unknown: {nearest(str(key), names)}'
            )
