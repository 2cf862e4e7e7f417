"""The closed loop of one axis beside its records: it refines effects, and contradicts them."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.closed_loop.dither import sticks
from gap_diagnosis.closed_loop.polish import LoopFit
from gap_diagnosis.closed_loop.replay import (
    AWAY,
    fitted_gap,
    mean_square,
    of_axis,
    replayed_gap,
    replays,
)
from gap_diagnosis.closed_loop.slides import slides, sliding
from gap_diagnosis.closed_loop.steps import stepless, unrepeated_steps, without_steps
from gap_diagnosis.evidence.judgement import channel_floor
from gap_diagnosis.input.data import Record
from gap_diagnosis.input.noise import Noise
from gap_diagnosis.input.windows import (
    fitted_ticks,
    held_out_windows,
    inside,
    judging,
    scored_ticks,
)
from gap_diagnosis.memory import Memory
from gap_diagnosis.parameters import Effects, Parameters, plain_values
from gap_diagnosis.residuals.measured_noise import with_noise
from stage_core.arrays import Array
from stage_core.errors import StageError
from stage_core.quantities import split_effect
from stage_core.twin_file import TwinFile

#: Floors of the encoder up to which the loop follows the record.
FOLLOWS = 2.0
#: Share of the loop's held-out gap that is left with an effect that was lacking. A right lag
#: beside a friction left 0.36, a right richer friction 0.07; what takes up errors of a friction's
#: model 0.83 or more.
LEFT = 0.5
#: Share of the squared gap above the floor that values which suit the sliding axis leave there of
#: what others leave. Of right lags of six machines it was 0.003 to 0.24, of a wrong gain of
#: the drive 1.0.
CLOSER = 0.25


@dataclass(frozen=True)
class AxisLoop:
    """What the twin's loop makes of the recorded references of an axis.

    Attributes
    ----------
    records : arrays of all sessions
    twin : the nominal twin
    axis : whose encoder counts
    known : effects of all axes that are known before any is fitted
    memory : of what was refined
    sliding : whether only ticks at which the axis slides count
    """

    records: list[Record]
    twin: TwinFile
    axis: str
    known: Parameters = field(default_factory=dict)
    memory: Memory = field(default_factory=Memory)
    sliding: bool = False

    @property
    def channel(self) -> str:
        """Name of the encoder's gap."""
        return f'encoder.{self.axis}'

    @cached_property
    def floor(self) -> float:
        """Noise floor of the encoder [m]."""
        return channel_floor(with_noise(self.twin, self.records), self.channel)

    def beside(self, names: Iterable[str]) -> AxisLoop:
        """The loop as it tells effects: behind a stated friction where it slides.

        Other frictions are told wherever it goes.
        """
        told = not sticks(names) and slides(self.records, self.twin, self.axis)
        return replace(self, sliding=told)

    def refined(self, found: Parameters) -> Parameters:
        """Effects of the axis with their parameters refined in the loop (`polish`).

        Behind a friction that the twin states these are what suits the loop where it slides, if
        it follows the record far `CLOSER` there than with the others: reversals hold the error of
        that friction, and so does the force balance. Where the others leave little beside the
        noise, they stand.
        """
        own = self._own()
        key = (self.axis, repr((found, own, self._machine({*found, *own}))))
        return self.memory.once(key, lambda: self._refined(found, own))

    def _machine(self, names: Collection[str]) -> tuple[Effects, list[Noise | None]]:
        """Of the twin and of the records, what changes the loop with some effects.

        The records' noise says how each axis rests.
        """
        alone = [of_axis(record, self.twin, names, self.axis) for record in self.records]
        axes = (None, *alone[0].axes)
        stated = {n: v for n, v in self.twin.effects.items() if split_effect(n)[1] in axes}
        return stated, [record.noise for record in alone]

    def _refined(self, found: Parameters, known: Parameters) -> Parameters:
        """The same beside effects that are known."""
        fit = LoopFit(self.records, self.twin, self.axis, known)
        whole, told = fit.polish(found), self.beside(found)
        if not told.sliding or (left := told._excess(whole)) < self.floor**2:
            return whole
        own = replace(fit, ticks=told._fitted).polish(found, alone=True)
        return own if told._excess(own) < CLOSER * left else whole

    def _excess(self, found: Parameters) -> float:
        """Mean square of the gap above the floor on the ticks that fit [m²]."""
        effects = self.with_known(found)
        gap = fitted_gap(self.records, self.twin, effects, self.axis, ticks=self._fitted)
        return gap**2 - self.floor**2

    def closest(self, found: Parameters) -> float:
        """Least RMS of the gap that effects leave where they are fitted [m]."""
        fit = LoopFit(self.records, self.twin, self.axis, self._own(), self._fitted)
        return fit.closest(found)

    def _own(self) -> Parameters:
        """What is known of the axis itself."""
        return {n: v for n, v in self.known.items() if n.endswith(f'.{self.axis}')}

    def with_known(self, found: Parameters) -> dict[str, dict[str, float]]:
        """Values of effects, those of the known ones among them, as the loop is run with them."""
        effects = plain_values({**found, **self.known})
        out = unrepeated_steps(self.records, self.twin, effects)
        return {n: v for n, v in effects.items() if n not in out}

    def gap(self, effects: Effects) -> float:
        """Gap of the encoder on the held-out ticks [m]; infinite where no machine could run."""
        scored = judging(self.records)
        return replayed_gap(scored, self.twin, effects, self.axis, self._held_out)

    def _held_out(self, record: Record) -> NDArray[np.bool_]:
        """Held-out ticks (n,) at which the gap counts."""
        return self._counting(record, scored_ticks(record))

    def _fitted(self, record: Record) -> NDArray[np.bool_]:
        """Ticks (n,) to which effects are fitted."""
        return self._counting(record, fitted_ticks(record))

    def _counting(self, record: Record, ticks: NDArray[np.bool_]) -> NDArray[np.bool_]:
        return ticks & sliding(record, self.twin, self.axis) if self.sliding else ticks

    def window_gaps(self, found: Parameters) -> Array:
        """RMS (w,) of the gap in each held-out window [m], of a loop without encoder steps.

        The effects `found` are refined on the other windows. Where no machine could run with
        them, the gap is `AWAY`.
        """
        twin = stepless(self.twin, self.axis)
        effects = plain_values({**without_steps(self.known), **self.refined(found)})
        out = []
        for record in judging(self.records):
            try:
                own = of_axis(record, twin, effects, self.axis)
                squares = mean_square(replays(own, twin, effects), self.channel)
            except StageError:
                squares = np.full(len(record.time), AWAY**2)
            for window in held_out_windows(record):
                rows = inside(record.time, [window]) & record.whole(record.time)
                if np.any(rows):
                    out.append(float(np.sqrt(np.mean(squares[rows]))))
        return np.array(out)
