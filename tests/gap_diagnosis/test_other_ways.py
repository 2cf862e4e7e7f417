"""Selections that begin with an effect that another one was taken before."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from gap_diagnosis.selection import other_ways


@pytest.mark.parametrize('better', [True, False])
def test_a_better_set_counts_without_the_effect_that_led_to_it(
    monkeypatch: pytest.MonkeyPatch, better: bool
) -> None:
    # A small rotation led to a play and a heat that leave nothing, and was pruned beside them.
    best = SimpleNamespace(accepted=['angular_error.y'])
    other = SimpleNamespace(accepted=['backlash.y', 'thermal_expansion.y'])
    terms: dict[str, Any] = {'angular_error.y': None}
    selector: Any = SimpleNamespace(
        problem=SimpleNamespace(terms=terms), gap=1.0, select=lambda first: other
    )
    monkeypatch.setattr(other_ways, '_better', lambda *sets: better)
    chosen: Any = other_ways._other_way(selector, best, ['tracker_misalignment'], terms, 1.0)  # type: ignore[arg-type]
    assert chosen is (other if better else best)
