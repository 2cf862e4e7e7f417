"""The compiled filters beside SciPy's."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import butter, lfilter, sosfiltfilt

from gap_diagnosis.residuals.low_pass import band_limited, smooth

PERIOD = 1e-3


@pytest.mark.parametrize('shape', [(), (1,), (7,)])
@settings(deadline=None)
@given(corner=st.floats(5.0, 400.0), seed=st.integers(0, 99), count=st.integers(16, 9000))
def test_low_pass_is_that_of_scipy(
    shape: tuple[int, ...], corner: float, seed: int, count: int
) -> None:
    rows = np.random.default_rng(seed).standard_normal((count, *shape)).cumsum(0)
    sections = butter(4, 2.0 * corner * PERIOD, output='sos')
    expected = sosfiltfilt(sections, rows, axis=0)
    np.testing.assert_allclose(
        band_limited(rows, PERIOD, corner), expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max()
    )


@pytest.mark.parametrize('shape', [(), (3,)])
@settings(deadline=None)
@given(corner=st.floats(3.0, 400.0), seed=st.integers(0, 99), count=st.integers(2, 9000))
def test_smoothing_is_that_of_a_filter_of_first_order_both_ways(
    shape: tuple[int, ...], corner: float, seed: int, count: int
) -> None:
    rows = np.random.default_rng(seed).standard_normal((count, *shape)).cumsum(0)
    decay = math.exp(-2.0 * math.pi * corner * PERIOD)

    def once(signal: np.ndarray) -> np.ndarray:
        return lfilter([1.0 - decay], [1.0, -decay], signal, axis=0, zi=decay * signal[:1])[0]

    expected = once(once(rows)[::-1])[::-1]
    np.testing.assert_allclose(
        smooth(rows, PERIOD, corner), expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max()
    )
