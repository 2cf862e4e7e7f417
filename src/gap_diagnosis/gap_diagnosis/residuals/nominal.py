"""Effects that the nominal twin has already: part of its prediction, free to be re-estimated.

A corrected twin is the nominal one of the next diagnosis. What its effects predict is taken out of
the residuals by the twin's own model; a candidate of the same name puts its share back and is
fitted anew, so that it is named where its parameters have changed, and replaces the old one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from gap_diagnosis.input.coarse import Coarse
from gap_diagnosis.input.data import Record
from gap_diagnosis.parameters import Effects
from stage_core.arrays import Array
from stage_core.quantities import split_effect
from stage_core.twin_file import TwinFile
from stage_twin.effects import effect_of, held_by, link_of
from stage_twin.effects.term import Term, Theta
from stage_twin.kinematics import carry, motor_path
from stage_twin.measured_force import required_force

QUANTISATION, INTERPOLATION = 'encoder_quantisation', 'encoder_interpolation'
NOTHING = 0.05  # of what the twin's effect does, below which the machine does not have it


def merged(twin: TwinFile, effects: Effects) -> TwinFile:
    """The twin with these effects; those of its own that one of them holds go."""
    gone = {held for name in effects for held in held_by(name)}
    own = {n: v for n, v in twin.effects.items() if n not in gone}
    return replace(twin, effects=own).with_effects(effects)


def with_counted_steps(twin: TwinFile) -> TwinFile:
    """The twin with the encoder steps that its own effects say."""
    axes = dict(twin.axes)
    for name, values in twin.effects.items():
        effect, axis = split_effect(name)
        if effect == QUANTISATION and axis in axes:
            axes[axis] = replace(axes[axis], encoder_resolution=values['resolution'])  # type: ignore[arg-type]
    return replace(twin, axes=axes)


def sensor_frame(twin: TwinFile) -> Coarse:
    """Frame and clock of the tracker as the twin's effects have them."""
    place = twin.effects.get('tracker_misalignment', {})
    return Coarse(
        place.get('angle', 0.0),
        tuple(place.get(f'offset_{axis}', 0.0) for axis in ('x', 'y')),
        twin.effects.get('tracker_latency', {}).get('latency', 0.0),
        twin.effects.get('tracker_clock_drift', {}).get('drift', 0.0),
    )


def re_estimated(
    terms: dict[str, Term], own: list[str], share: Callable[[tuple[str, ...]], Array]
) -> dict[str, Term]:
    """The candidates, where the twin has some of them already.

    A candidate puts back the `share` of the effects that it would replace: its own and those that
    it holds as special cases. What one of the twin's effects holds is estimated with that one.
    """
    out = {}
    held = {name for effect in own for name in held_by(effect)}
    for name, term in terms.items():
        if name in held and name not in own:
            continue
        replaced = tuple(n for n in own if n == name or n in held_by(name))
        out[name] = _over(name, term, share(replaced)) if replaced else term
    return out


def _over(name: str, term: Term, base: Array) -> Term:
    """The candidate over what the twin has; next to nothing of it is an answer, too."""
    nothing = NOTHING * float(np.linalg.norm(base))
    limits = effect_of(name).parameters

    def admissible(theta: Theta, coefficients: Array) -> bool:
        if term.admissible(theta, coefficients):
            return True
        return float(np.linalg.norm(term.columns(theta) @ coefficients)) < nothing

    def parameters(theta: Theta, coefficients: Array) -> dict[str, float]:
        found = term.parameters(theta, coefficients)
        for known in limits:
            if known.name in found:
                found[known.name] = float(np.clip(found[known.name], known.minimum, known.maximum))
        return found

    def richer() -> Term:
        assert term.next is not None
        return _over(name, term.next, base)

    return replace(
        term,
        base=base,
        admissible=admissible,
        parameters=parameters,
        richer=None if term.richer is None else richer,
    )


class Prediction:
    """What the twin's effects add to the residuals, of one record."""

    def __init__(self, record: Record, twin: TwinFile) -> None:
        self.record = record
        axes = {a: twin.axes[a] for a in record.axes}
        own = {n: dict(v) for n, v in twin.effects.items() if split_effect(n)[1] in (None, *axes)}
        self.twin = replace(twin, axes=axes, effects=own)

    def names(self, link: str, axis: str | None = None) -> list[str]:
        """The twin's effects of a link, of one axis where it is named."""
        return [
            name
            for name in self.twin.effects
            if link_of(name) == link
            and axis in (None, split_effect(name)[1])
            and split_effect(name)[0] != QUANTISATION
        ]

    def seen(self) -> list[str]:
        """The twin's effects that part the table from the encoder."""
        misread = [n for n in self.names('sensor') if split_effect(n)[0] == INTERPOLATION]
        return self.names('kinematic') + misread

    def table(self, without: tuple[str, ...] = ()) -> Array:
        """Table minus encoder (m, a) [m] at the tracker's points."""
        record = self.record
        kept = {n: self.twin.effects[n] for n in self.seen() if n not in without}
        twin = replace(self.twin, effects=kept, tracker=None)
        warm = record.temperature
        if warm is None:
            warm = np.full_like(record.encoder, twin.temperature_reference)
        path = carry(twin, motor_path(twin, record.encoder), warm)
        assert record.tracker_time is not None
        moved = path - record.encoder
        return np.column_stack(
            [np.interp(record.tracker_time, record.time, column) for column in moved.T]
        )

    def force(self, axis: str, without: tuple[str, ...] = ()) -> Array:
        """Force (n,) [N] that the twin's effects need for the recorded motion of an axis."""
        names = [n for n in self.names('servo', axis) if n not in without]
        twin = replace(self.twin, effects={n: self.twin.effects[n] for n in names})
        i = self.record.column(axis)
        plain = required_force(replace(twin, effects={}), self.record.encoder)
        return np.asarray((required_force(twin, self.record.encoder) - plain)[:, i])
