"""How much wider than its own estimate a standard deviation has to be for its interval to hold."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from benchmarks.calibrate.figures import NO_SHARE
from benchmarks.calibrate.truth import belongs_to_machine
from gap_diagnosis.evidence.describe import is_magnitude, model_of
from stage_core.arrays import Array
from stage_core.metrics import SIGMAS
from stage_core.quantities import LINKS
from stage_twin.effects import effect_of

Row = dict[str, Any]
Spread = dict[str, tuple[float, float]]

HOLDS = 0.95
FACTORS = np.geomspace(1.0, 10.0, 60)
#: Relative difference that counts as none: gains read from a record are told to all their digits.
ROUNDING = 1e-9
SHARES = np.concatenate([[0.0], np.geomspace(1e-5, 0.1, 60)])


def spread_of(rows: Sequence[Row]) -> Spread:
    """Per kind of model: factor on a deviation, and share of the value that is added in squares.

    Of the pairs with which 95 % of the truths are held, the one with the narrowest intervals
    (geometric mean of their widths) counts. A session counts once, however many parameters it
    tells: what spoils one of them spoils its others. Few sessions ask for more: of n the share
    held is 0.95 (n + 1) / n, at most all (conformal prediction; Vovk et al., 2005). Sessions whose
    verdict is not exact are left out: beside a wrong name no interval of a right one can hold.
    """
    return {model: _narrowest(_of_model(rows, model)) for model in ('friction', *LINKS)}


def _of_model(rows: Sequence[Row], model: str) -> Array:
    """Of each interval: relative error, relative deviation, whether a share counts, doubt, weight.

    Shape (n, 5). The weights of a session's intervals add up to 1.
    """
    found = [told for row in rows if row['exact'] for told in _of_session(row, model)]
    return np.array(found, dtype=float).reshape(-1, 5)


def _of_session(row: Row, model: str) -> list[tuple[float, ...]]:
    told = [
        (
            *(sigmas * width / (2.0 * SIGMAS), width / (2.0 * SIGMAS)),
            *(is_magnitude(name, parameter), _doubt(row, name, parameter)),
        )
        for name, parameter, sigmas, width in row.get('intervals', [])
        if model_of(name) == model and belongs_to_machine(name, parameter) and width < NO_SHARE
    ]
    return [(*one, 1.0 / len(told)) for one in told]


def _doubt(row: Row, name: str, parameter: str) -> float:
    """Share of the value that a report adds for what every fit gets wrong of the parameter."""
    shown = [told for effect, told, *_ in row['intervals'] if effect == name]
    return effect_of(name).parameter(parameter).doubted(shown)


def _narrowest(found: Array) -> tuple[float, float]:
    if not len(found):
        return 1.0, 0.0
    error, own, counts, doubt, weight = found.T
    sessions = weight.sum()
    wanted = min(HOLDS * (sessions + 1.0) / sessions, 1.0)
    best, least = (float(FACTORS[-1]), float(SHARES[-1])), math.inf
    for share in SHARES:
        for factor in FACTORS:
            model = np.hypot(share * counts, doubt)
            deviation = np.maximum(np.hypot(factor * own, model), ROUNDING)
            held = np.abs(error) <= SIGMAS * deviation
            if np.average(held, weights=weight) >= wanted - ROUNDING:
                width = float(np.average(np.log(deviation), weights=weight))
                if width < least:
                    best, least = (float(factor), float(share)), width
                break
    return best


def widened(rows: Sequence[Row], spread: Spread) -> list[Row]:
    """The sessions with their intervals as a report with this spread states them."""
    return [
        {**row, 'intervals': [_wider(row, i, spread) for i in row.get('intervals', [])]}
        for row in rows
    ]


def _wider(row: Row, interval: Sequence[Any], spread: Spread) -> tuple[str, str, float, float]:
    name, parameter, sigmas, width = interval
    factor, share = spread[model_of(name)]
    share = share if is_magnitude(name, parameter) else 0.0
    model = 2.0 * SIGMAS * math.hypot(share, _doubt(row, name, parameter))
    wider = max(math.hypot(factor * width, model), 2.0 * SIGMAS * ROUNDING)
    return name, parameter, sigmas * width / wider, wider
