"""How the coefficients of waves become periods, amplitudes and phases."""

from __future__ import annotations

import numpy as np
import pytest

from stage_twin.effects import periodic


def test_a_second_harmonic_that_stands_alone_is_the_period() -> None:
    coefficients = np.array([0.01, 0.0, 3.0, 4.0, 0.0, -0.02])
    found = periodic.found((100.0,), coefficients)
    assert found['period'] == pytest.approx(0.005)
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
