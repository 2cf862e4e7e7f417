"""What a motion does not show: every effect of the library at a usual size, against every other.

The usual size is that at which a twin file switches an effect on. What was named stands with the
parameters that were found. Of the difference that an effect makes only that part counts which
no multiple of another effect's makes as well.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.evidence.acceptance import LEAST_SEEN
from gap_diagnosis.experiment.separation import apart
from gap_diagnosis.input.checks import turns
from gap_diagnosis.parameters import Effects
from gap_diagnosis.result import Diagnosis
from stage_core.arrays import Array
from stage_core.errors import StageError
from stage_core.quantities import UNKNOWN, split_effect
from stage_twin.effects import EFFECTS, effect_of

#: Channels (c, m) of a motion with any effects.
Shown = Callable[[Effects], Array]

#: Share of what an effect does that another one may do with other parameters than the usual ones:
#: only multiples are compared. Strokes one way leave 0.016 of an offset beside a Coulomb friction,
#: strokes of the whole travel 0.037 of that beside Stribeck friction.
ALIKE = 0.025
#: Share of the library that strokes of the whole travel have to show beyond a session, before that
#: is asked what it does not show. It is 0 to 4 % after strokes over 60 mm and a sweep; after
#: sessions of little motion 6 to 9 % within their own travel, 19 to 21 % within 80 mm.
MUCH = 0.05


@dataclass(frozen=True, eq=False)
class Library:
    """Effects that a machine may have beside or in place of what was named.

    Attributes
    ----------
    sides : name (k) -> effects of the twin with it and without it
    products : of what the effects do in the sessions (c, k, k), summed over their values
    values : how many a channel of the sessions has
    """

    sides: Mapping[str, tuple[Effects, Effects]] = field(default_factory=dict)
    products: Array = field(default_factory=lambda: np.zeros((0, 0, 0)))
    values: int = 0

    @property
    def names(self) -> list[str]:
        """Names (k,) of the effects."""
        return list(self.sides)

    def only(self, kept: NDArray[np.bool_]) -> Library:
        """The library of some (k,) of its effects."""
        sides = {n: s for (n, s), keep in zip(self.sides.items(), kept, strict=True) if keep}
        return Library(sides, self.products[:, kept][:, :, kept], self.values)

    def made(self, shown: Shown) -> Array:
        """Channels (c, k, m) that the effects add to a motion, over their noise.

        `shown` are the channels (c, m) of the motion with any effects.
        """
        each = [apart(shown(a), shown(b)) for a, b in self.sides.values()]
        return np.stack(each, axis=1) if each else np.zeros((0, 0, 0))

    def margins(self, products: Array | float = 0.0, values: int = 0) -> Array:
        """How far each effect (k,) stands out from each and, last, from nothing (k, k + 1).

        Above 1 a diagnosis of the sessions and of motions with these products tells it; infinite
        where none is asked to. One multiple of the other effect holds for all of a channel.
        """
        gram = (self.products + products) / max(1, self.values + values)
        if not self.sides:
            return np.zeros((0, 1))
        own = np.einsum('cii->ci', gram)
        imitated = gram**2 / np.maximum(own, 1e-30)[:, None, :]
        left = np.concatenate([own[:, :, None] - imitated, own[:, :, None]], axis=2)
        found = np.max(left / (LEAST_SEEN + ALIKE * own[:, :, None]), axis=0)
        return np.where(self._asked(), found, np.inf)

    def _asked(self) -> NDArray[np.bool_]:
        """Pairs that a selection tells apart: an effect is none without its special cases."""
        kinds = [split_effect(name) for name in self.names]
        asked = [
            [a != b and not (a[1] == b[1] and a[0] in EFFECTS[b[0]].holds) for b in kinds]
            for a in kinds
        ]
        return np.column_stack([np.reshape(asked, (len(kinds),) * 2), np.ones(len(kinds), bool)])


def left_open(found: Diagnosis, shown: Sequence[Shown], bold: Shown) -> Library:
    """The effects that a machine may have after some sessions.

    What they would have told from nothing and from all that was named is not there at its usual
    size, unless something unknown remains in which it may be. `shown` are the channels (c, m) of
    each session, `bold` those of strokes of the whole travel. Where these tell little more, none
    is asked.
    """
    library = _simulated(found, shown, bold)
    told = library.margins() > 1.0
    names = np.array(library.names, dtype=str)
    hidden, named = ~told[:, -1], np.isin(names, found.accepted)
    like = np.zeros_like(told)
    like[:, :-1] = ~told[:, :-1] & ~hidden[:, None] & (named[:, None] | named)
    if UNKNOWN in found.verdict:
        below_noise = [c.effect for c in found.causes if c.status == 'below_noise']
        return library.only(hidden | named | ~np.isin(names, below_noise))
    new = _beside(library, bold) > 1.0
    if np.sum(new[hidden, -1]) < MUCH * len(names) and not np.any(new[like]):
        return Library()
    return library.only(hidden | named | like.any(axis=1) | like[:, :-1].any(axis=0))


def _beside(library: Library, shown: Shown) -> Array:
    """Margins in the sessions and one more motion (k, k + 1)."""
    made = library.made(shown)
    return library.margins(made @ made.transpose(0, 2, 1), made.shape[-1])


def _simulated(found: Diagnosis, shown: Sequence[Shown], bold: Shown) -> Library:
    """What was named, what was refused, and what needs a reversal that no session has.

    An effect with which the twin cannot run the motions, or that moves no channel, is none.
    """
    names = [c.effect for c in found.causes if split_effect(c.effect)[0] in EFFECTS]
    sides = {}
    for name in dict.fromkeys([*found.effects, *names, *_never_turned(found)]):
        rest = {n: v for n, v in found.effects.items() if n != name}
        own = found.effects.get(name, effect_of(name).defaults())
        try:
            moved = [np.ptp(one({**rest, name: own}) - one(rest)) > 0.0 for one in (*shown, bold)]
        except StageError:
            continue
        if not any(moved):
            continue
        sides[name] = ({**rest, name: own}, rest)
    made = np.concatenate([Library(sides).made(one) for one in shown], axis=2)
    return Library(sides, made @ made.transpose(0, 2, 1), made.shape[-1])


def _never_turned(found: Diagnosis) -> list[str]:
    """Effects that need a reversal, of the axes that moved and never turned back."""
    axes = found.records[0].axes
    counts = turns(found.records)
    still = [a for i, a in enumerate(axes) if any(r.moving[i] for r in found.records)]
    return [
        f'{e.name}.{a}' for a in still if counts[a] == 0 for e in EFFECTS.values() if e.reverses
    ]
