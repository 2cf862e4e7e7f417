"""The compiled filters beside SciPy's."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import butter, sosfiltfilt

from gap_diagnosis.residuals.operators import band_limited

PERIOD = 1e-3


@pytest.mark.parametrize('shape', [(), (1,), (7,)])
@settings(deadline=None)
@given(corner=st.floats(5.0, 400.0), seed=st.integers(0, 99), count=st.integers(16, 600))
def test_low_pass_is_that_of_scipy(
    shape: tuple[int, ...], corner: float, seed: int, count: int
) -> None:
    rows = np.random.default_rng(seed).standard_normal((count, *shape)).cumsum(0)
    sections = butter(4, 2.0 * corner * PERIOD, output='sos')
    expected = sosfiltfilt(sections, rows, axis=0)
    np.testing.assert_allclose(
        band_limited(rows, PERIOD, corner), expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max()
    )
