"""An HRA curve as a contour of the contour controller."""

from __future__ import annotations

import numpy as np
import pytest

from contour_ctrl.curves import check_regular
from hra_curves import HraCurve, Trigonometric, interpolate
from hra_curves.arc_length import ArcLength


def arc() -> HraCurve:
    basis = Trigonometric(1.4)
    angle = np.linspace(*basis.domain, 9)
    return interpolate(0.02 * np.column_stack([np.cos(angle), np.sin(angle)]), basis)


def test_the_contour_controller_takes_the_curve() -> None:
    curve = arc()
    check_regular(curve)
    table = ArcLength.of(curve)
    assert table.total == pytest.approx(0.02 * 2.8, rel=1e-10)
    wanted = np.linspace(0.0, table.total, 7)
    np.testing.assert_allclose(table.parameter(wanted), np.linspace(-1.4, 1.4, 7), atol=1e-7)


def test_the_curvature_of_an_arc_is_that_of_its_circle() -> None:
    curve = arc()
    _, first, second = curve.derivatives(np.linspace(*curve.domain, 21), 2)
    cross = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
    curvature = cross / np.linalg.norm(first, axis=1) ** 3
    np.testing.assert_allclose(curvature, 50.0, rtol=1e-9)
