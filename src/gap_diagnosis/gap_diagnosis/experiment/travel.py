"""What an experiment may use of each axis, as a user writes it."""

from __future__ import annotations

import math
from collections.abc import Sequence

from stage_core.errors import StageError

FILE = 'experiment.csv'  # the motion of an experiment, beside the report


def travel_of(given: Sequence[str]) -> dict[str, tuple[float, float]]:
    """Ends [m] by axis of texts such as ``x:-0.05:0.05``.

    Raises
    ------
    StageError
        For another text, and for ends that leave no travel.
    """
    out = {}
    for text in given:
        try:
            axis, low, high = text.split(':')
            out[axis] = float(low), float(high)
        except ValueError:
            raise StageError(f'--travel {text}: give AXIS:LOW:HIGH, as x:-0.05:0.05') from None
        if not -math.inf < out[axis][0] < out[axis][1] < math.inf:
            raise StageError(f'--travel {text}: LOW must be below HIGH, both finite')
    return out
