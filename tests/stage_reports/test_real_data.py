"""The standard figures on real measurements: a rotary positioning test and a milling circle."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from stage_reports import circular, positioning
from stage_reports.extract import circular_paths


def test_reversal_and_repeatability_of_a_real_axis(data_root: Path) -> None:
    """72 stops of a geared axis, six from either side of each target; angles in radians."""
    record = np.load(data_root / 'ess_tank' / 'repeatability.npz')
    target = np.round(record['motor'], 3)
    deviation = record['encoder'] - record['motor']
    # At the last target the encoder counts from another origin.
    known = np.unique(target)[:5]
    sides = [
        np.array([deviation[(target == t) & (record['approach'] == sign)] for t in known])
        for sign in (1.0, -1.0)
    ]
    result = positioning(known, sides[0], sides[1])
    assert sides[0].shape == sides[1].shape == (5, 6)
    # Backlash of about 0.29 mrad, always the same way round, ten times the one-sided scatter.
    assert (result.reversal < -0.2e-3).all()
    assert result.B_mean == pytest.approx(-0.288e-3, abs=0.01e-3)
    assert max(result.R_up, result.R_down) < 0.04e-3
    assert result.B < result.R < 0.42e-3
    assert result.M < result.E < result.A < 0.6e-3


@pytest.mark.parametrize('name', ['day1_a', 'day2_b'])
def test_the_circle_of_a_real_stage_is_found(data_root: Path, name: str) -> None:
    record = np.load(data_root / 'xy_circle' / f'{name}.npz')
    paths = circular_paths(record['reference'], record['encoder'])
    assert paths is not None
    assert paths.radius == pytest.approx(0.12, rel=0.02)
    lap = paths.counter_clockwise if paths.clockwise is None else paths.clockwise
    assert lap is not None
    result = circular(lap, None, paths.radius, paths.centre)
    # Errors of the order of a millimetre; the nominal centre can only widen the band.
    assert 2e-4 < result.G < 3e-3
    assert result.F_max - result.F_min >= result.G
