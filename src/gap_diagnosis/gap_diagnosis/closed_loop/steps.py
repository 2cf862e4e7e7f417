"""The steps of an encoder in the loop of a twin: one that rounds elsewhere goes another way."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TypeVar

from gap_diagnosis.closed_loop.dither import STEPLESS
from gap_diagnosis.closed_loop.replay import fitted_gap
from gap_diagnosis.input.data import Record
from gap_diagnosis.parameters import Effects
from gap_diagnosis.residuals.nominal import QUANTISATION
from stage_core.quantities import split_effect
from stage_core.twin_file import TwinFile

Values = TypeVar('Values')


def stepless(twin: TwinFile, axis: str) -> TwinFile:
    """The twin whose encoder of an axis does not round.

    A rounded position makes the gap a rough function of the parameters: a loop that rounds
    elsewhere goes another way.
    """
    smooth = replace(twin.servo(axis), encoder_resolution=STEPLESS)
    return replace(twin, axes={**twin.axes, axis: smooth})


def without_steps(fixed: Mapping[str, Values]) -> dict[str, Values]:
    """The effects without the steps of encoders."""
    return {n: v for n, v in fixed.items() if split_effect(n)[0] != QUANTISATION}


def unrepeated_steps(
    records: Sequence[Record], twin: TwinFile, effects: Effects
) -> tuple[str, ...]:
    """Steps of encoders with which the loop follows the fitted ticks no better than without.

    A loop that rounds at other moments only adds the noise of its own steps, and what it answers
    to them.
    """
    untold = {axis for record in records for axis in record.untold}

    def gap(name: str, effects: Effects) -> float:
        return fitted_gap(records, twin, effects, name[-1])

    coarse = [n for n in effects if split_effect(n)[0] == QUANTISATION and n[-1] not in untold]
    return tuple(
        name
        for name in coarse
        if gap(name, effects) >= gap(name, {n: v for n, v in effects.items() if n != name})
    )
