"""How the coefficients of waves become periods, amplitudes and phases."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from stage_twin.effects import periodic
from stage_twin.effects.term import Array, Term


@pytest.mark.parametrize('harmonic', [2, 3])
def test_a_higher_harmonic_that_stands_alone_is_the_period(harmonic: int) -> None:
    coefficients = np.array([0.01, 0.0, 0.0, -0.02, -0.02, 0.01])
    coefficients[2 * harmonic - 2 : 2 * harmonic] = 3.0, 4.0
    found = periodic.found((100.0,), coefficients)
    assert found['period'] == pytest.approx(0.01 / harmonic)
    assert found['amplitude'] == pytest.approx(5.0)
    assert found['phase'] == pytest.approx(np.arctan2(4.0, 3.0))
    assert found['amplitude_2'] == found['amplitude_3'] == 0.0


def test_harmonics_beside_their_first_stay_harmonics() -> None:
    coefficients = np.array([1.0, 0.0, 3.0, 4.0, 0.0, 0.0])
    found = periodic.found((100.0,), coefficients)
    assert found['period'] == pytest.approx(0.01)
    assert (found['amplitude'], found['amplitude_2']) == pytest.approx((1.0, 5.0))


def test_a_cogging_of_72_periods_in_a_turn_shows_over_many_turns() -> None:
    """As that of a motor which its makers turned 23 times: its period is 1/1700 of the travel."""
    lead, order = 2.0 * np.pi, 72
    generator = np.random.default_rng(1)
    position = np.cumsum(generator.uniform(0.002, 0.007, 33_000))
    assert np.ptp(position) > 22 * lead
    residual = 0.1 * generator.standard_normal(len(position))
    residual += 0.1 * np.sin(order * position)
    found = periodic.starts(position, (), lead)(residual)
    assert found[0][0] == pytest.approx(order / lead, abs=0.25 / np.ptp(position))
    low, high = periodic.bounds(position, lead)
    assert low < order / lead < high


@pytest.mark.parametrize(('travel', 'richer'), [(0.05, 1 + periodic.WAVES), (1e-3, 1)])
def test_every_richer_shape_has_a_start_and_bounds_of_its_own(travel: float, richer: int) -> None:
    """Also over a travel in which the shortest wave of the table turns less than three times."""
    path, low = np.linspace(0.0, travel, 4000), 1.0 / travel
    plain = Term(
        lambda theta: np.zeros((0, 2)),
        periodic.found,
        grid=((low,),),
        propose=lambda residual: ((2.0 * low,),),
        lower=(low,),
        upper=(1.0 / 0.6e-3,),
    )

    def make(waves: Callable[[Array], list[Array]]) -> Array:
        return np.column_stack(waves(path))

    term = periodic.along_the_travel(plain, make, path, 0.01)
    # A recorded rotary axis turns 2.4 times: any curve would be such a wave, and lose its name.
    assert term.deepens((3.0 * low,)) and not term.deepens((2.4 * low,))
    slow = periodic.with_harmonics(plain, lambda harmonics, theta: np.zeros((0, 2)), term)
    for _ in range(2, periodic.HARMONICS):
        assert slow.next is not None and slow.deepens((2.4 * low,))
        slow = slow.next
    assert slow.next is term
    for _ in range(richer):
        assert term.next is not None
        term = term.next
        assert term.propose is not None
        (start,), (proposed,) = term.grid, term.propose(np.sin(4.0 * np.pi * low * path))
        assert len(start) == len(proposed) == len(term.lower) == len(term.upper) > 1
        assert len(term.steps) == len(start)
        assert all(a < b for a, b in zip(term.lower, term.upper, strict=True))
        columns = term.columns(start)
        assert columns.shape == (len(path), len(term.nuisances))
        assert term.parameters(start, np.ones(columns.shape[1]))['amplitude'] > 0.0
    assert term.next is None
