"""Columns that two effects of a set have: whose are they?"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from stage_core.arrays import Array
from stage_twin.effects.term import Term


def yield_shared(
    terms: Mapping[str, Term], parts: Sequence[tuple[str, Array]], coefficients: dict[str, Array]
) -> None:
    """Leave a column that two terms have to the one of which it is a session's nuisance.

    The rows do not tell how much of it is whose: an offset of the tracker's frame is also one of
    a guide's reference line. `parts` are the columns (n, k) of the terms.
    """
    for owner, own in parts:
        for k in () if terms[owner].phase else terms[owner].nuisances:
            for name, part in [p for p in parts if p[0] != owner]:
                same = (own[:, k] == part.T).all(axis=1)
                coefficients[owner][k] += coefficients[name][same].sum()
                coefficients[name][same] = 0.0
