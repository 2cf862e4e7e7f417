"""The contour error estimates against the exact closest point."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from contour_ctrl import contour_error, curves
from contour_ctrl.path import PathTable
from hra_curves.arc_length import ArcLength

from .test_reference import ALL


def exact(curve: curves.Curve, arc: ArcLength, s: float, point: np.ndarray) -> float:
    """Signed distance to the closest point of the curve near arc s, by bounded search."""

    def distance(t: float) -> float:
        u = arc.parameter(np.mod(t, arc.total))
        return float(np.sum((curve.derivatives(u, 0)[0, 0] - point) ** 2))

    found = minimize_scalar(
        distance, bounds=(s - 6e-4, s + 6e-4), method='bounded', options={'xatol': 1e-12}
    ).x
    place, tangent = curve.derivatives(arc.parameter(np.mod(found, arc.total)), 1)[:, 0]
    angle = np.arctan2(tangent[1], tangent[0])
    error = place - point
    return float(-np.sin(angle) * error[0] + np.cos(angle) * error[1])


@pytest.mark.parametrize('name', sorted(ALL))
def test_parameter_estimate_is_the_closest_point(name: str) -> None:
    curve = ALL[name]
    arc = ArcLength.of(curve)
    path = PathTable.from_curve(arc)
    rng = np.random.default_rng(7)
    s = rng.uniform(0.0, arc.total, 40)
    place, tangent = curve.derivatives(arc.parameter(s), 1)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    normal = np.column_stack([-tangent[:, 1], tangent[:, 0]])
    lag, across = rng.uniform(-2e-4, 2e-4, (2, 40))
    points = place - lag[:, None] * tangent + across[:, None] * normal
    expected = np.array([exact(curve, arc, a, p) for a, p in zip(s, points, strict=True)])
    worst = {}
    for steps in (0, 1, 2):
        found = contour_error.estimates(path.values, path.step, path.closed, s, points, steps)
        worst[steps] = np.abs(found - expected).max()
    assert worst[2] < 2e-8
    assert worst[1] < 0.3 * worst[0]
    assert contour_error.of_record(path, s, points) == pytest.approx(expected, abs=2e-9)


def test_osculating_circle_is_exact_on_a_circle_and_on_a_line() -> None:
    path = PathTable.from_curve(ArcLength.of(curves.circle(0.02)))
    for point in ((0.021, 0.001), (0.019, -0.002), (0.0, 0.0201)):
        s = 0.02 * float(np.arctan2(point[1], point[0]) % (2 * np.pi))
        found = contour_error.osculating_estimate(
            path.values, path.step, True, s + 1e-3, point[0], point[1]
        )
        assert found == pytest.approx(np.hypot(*point) - 0.02, abs=1e-9)
    line = np.column_stack([np.linspace(0, 1, 50), np.zeros(50)])
    straight = PathTable.from_points(line, 1.0, False)
    value = contour_error.osculating_estimate(straight.values, straight.step, False, 0.5, 0.6, 0.1)
    assert value == pytest.approx(-0.1)


def test_sign_follows_the_interface() -> None:
    # Moving along +x, a point below the path lies to its right: e_y > 0, contour error > 0.
    line = np.column_stack([np.linspace(0, 1, 50), np.zeros(50)])
    path = PathTable.from_points(line, 1.0, False)
    found = contour_error.estimates(
        path.values, path.step, False, np.array([0.3]), np.array([[0.28, -0.01]]), 2
    )
    assert found[0] == pytest.approx(0.01)


def test_estimate_survives_a_point_beyond_the_centre_of_curvature() -> None:
    path = PathTable.from_curve(ArcLength.of(curves.circle(0.02)))
    found = contour_error.of_record(path, np.array([0.01]), np.array([[1e-4, -2e-4]]))
    assert np.isfinite(found).all()
    assert abs(found[0]) < 0.041
