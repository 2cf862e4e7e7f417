"""The recorded XY stage: published tracking errors, contour error, ratio of the frictions."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from contour_ctrl.contour_error import of_record
from contour_ctrl.curves import circle
from contour_ctrl.figures import figures
from contour_ctrl.identify_friction import identify
from contour_ctrl.path import PathTable
from hra_curves.arc_length import ArcLength


def test_contour_error_and_friction_of_the_recorded_stage(data_root: Path) -> None:
    file = data_root / 'xy_circle' / 'day2_a.npz'
    if not file.is_file():
        pytest.skip(f'no record at {file}')
    record = np.load(file)
    reference, encoder = record['reference'], record['encoder']
    centre = 0.5 * (reference.max(axis=0) + reference.min(axis=0))
    radius = float(np.median(np.hypot(*(reference - centre).T)))
    angle = np.unwrap(np.arctan2(*(reference - centre).T[::-1]))
    path = PathTable.from_curve(ArcLength.of(circle(radius, (centre[0], centre[1]))))
    contour = of_record(path, radius * np.mod(angle, 2.0 * np.pi), encoder)
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
