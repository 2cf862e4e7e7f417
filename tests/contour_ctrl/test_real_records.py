"""The recorded XY stage: published tracking errors, contour error, ratio of the frictions."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks.xy_circle_contour import contour_of, fitted_circle
from contour_ctrl.figures import figures
from contour_ctrl.identify_friction import identify


def test_contour_error_and_friction_of_the_recorded_stage(data_root: Path) -> None:
    file = data_root / 'xy_circle' / 'day2_a.npz'
    if not file.is_file():
        pytest.skip(f'no record at {file}')
    record = np.load(file)
    reference, encoder = record['reference'], record['encoder']
    centre, radius = fitted_circle(reference)
    contour = contour_of(reference, encoder)
    # Counter-clockwise, a point outside the circle has a positive contour error.
    assert contour == pytest.approx(np.hypot(*(encoder - centre).T) - radius, abs=1e-9)
    found = figures(reference - encoder, contour)
    assert found.x.rms == pytest.approx(366e-6, rel=0.01)
    assert found.contour.rms < np.hypot(found.x.rms, found.y.rms)
    x, y = (
        identify(
            encoder[:, axis],
            record['command'][:, axis],
            1e-3,
            0.01,
            record['contact_force'][:, :2],
        )
        for axis in range(2)
    )
    # The facts of the data: Coulomb friction about 1 : 0.3 in units of the command.
    assert 0.15 < y.model.coulomb / x.model.coulomb < 0.45
    assert x.residual < 0.5 * x.residual_without
