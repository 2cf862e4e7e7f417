"""ISO 230-2 and 230-4 against figures worked out by hand, and their invariances."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stage_core.errors import StageError
from stage_reports import circular, positioning
from stage_reports.iso230 import least_squares_circle, minimum_zone, radius_over_angle

MICRO = 1e-6


def test_positioning_by_hand() -> None:
    """Two targets, two approaches; s of {a, b} is |a - b|/sqrt(2)."""
    up = np.array([[1.0, 3.0], [5.0, 5.0]]) * MICRO
    down = np.array([[-1.0, -1.0], [2.0, 4.0]]) * MICRO
    result = positioning([0.0, 0.1], up, down)
    s = math.sqrt(2.0) * MICRO
    np.testing.assert_allclose(result.mean_up, [2 * MICRO, 5 * MICRO])
    np.testing.assert_allclose(result.mean_down, [-1 * MICRO, 3 * MICRO])
    np.testing.assert_allclose(result.deviation_up, [s, 0.0], atol=1e-20)
    np.testing.assert_allclose(result.deviation_down, [0.0, s], atol=1e-20)
    np.testing.assert_allclose(result.reversal, [3 * MICRO, 2 * MICRO])
    assert pytest.approx(3 * MICRO) == result.B
    assert result.B_mean == pytest.approx(2.5 * MICRO)
    assert result.R_up == pytest.approx(4 * s)
    assert result.R_down == pytest.approx(4 * s)
    # R_1 = max(2s + |3|; 4s; 0) = 5.83, R_2 = max(2s + |2|; 0; 4s) = 4s = 5.66.
    assert pytest.approx(2 * s + 3 * MICRO) == result.R
    assert pytest.approx(6 * MICRO) == result.E
    assert result.E_up == pytest.approx(3 * MICRO)
    assert result.E_down == pytest.approx(4 * MICRO)
    # Bidirectional means are 0.5 and 4.
    assert pytest.approx(3.5 * MICRO) == result.M
    # Highest of 2 + 2s, 5, -1, 3 + 2s; lowest of 2 - 2s, 5, -1, 3 - 2s.
    assert pytest.approx(max(5 * MICRO, 3 * MICRO + 2 * s) - (-1 * MICRO)) == result.A
    assert result.A_up == pytest.approx(5 * MICRO - (2 * MICRO - 2 * s))
    assert result.A_down == pytest.approx(3 * MICRO + 2 * s + 1 * MICRO)


@settings(max_examples=40, deadline=None)
@given(
    seed=st.integers(0, 10_000),
    targets=st.integers(1, 8),
    runs=st.integers(2, 6),
    shift=st.floats(-1e-3, 1e-3),
)
def test_positioning_invariances(seed: int, targets: int, runs: int, shift: float) -> None:
    generator = np.random.default_rng(seed)
    position = np.sort(generator.uniform(0.0, 0.3, targets))
    up = generator.normal(0.0, 1e-6, (targets, runs))
    down = generator.normal(2e-6, 1e-6, (targets, runs))
    result = positioning(position, up, down)
    assert result.A >= result.E >= 0.0
    assert max(result.A_up, result.A_down) <= result.A
    assert max(result.R_up, result.R_down, result.B) <= result.R
    assert result.A >= result.B
    moved = positioning(position, up + shift, down + shift)
    for name in ('A', 'R', 'E', 'B', 'M', 'B_mean'):
        assert getattr(moved, name) == pytest.approx(getattr(result, name), abs=1e-15)
    swapped = positioning(position, down, up)
    assert pytest.approx(result.A) == swapped.A
    assert swapped.B_mean == pytest.approx(-result.B_mean)
    order = generator.permutation(runs)
    assert pytest.approx(result.A) == positioning(position, up[:, order], down).A


def ring(radius: np.ndarray | float, count: int = 720, centre: tuple[float, float] = (0, 0)):
    angle = 2.0 * np.pi * np.arange(count) / count
    return np.asarray(centre) + np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])


def test_circular_by_hand() -> None:
    """A path 2 µm too large one way, 1 µm too small the other, on a 10 mm circle."""
    result = circular(ring(0.010002), ring(0.009999)[::-1], radius=0.010, centre=(0.0, 0.0))
    assert pytest.approx(0.0, abs=1e-12) == result.G
    assert result.G_clockwise == pytest.approx(0.0, abs=1e-12)
    assert result.G_b == pytest.approx(3 * MICRO, rel=1e-6)
    assert pytest.approx(3 * MICRO, rel=1e-6) == result.H
    assert result.F_max == pytest.approx(2 * MICRO, rel=1e-6)
    assert result.F_min == pytest.approx(-1 * MICRO, rel=1e-6)
    assert pytest.approx(0.5 * MICRO, rel=1e-6) == result.D


def test_an_ellipse_has_the_deviation_of_its_axes() -> None:
    """Squareness makes an ellipse: r = R + e sin 2a, so G = 2 e."""
    angle = 2.0 * np.pi * np.arange(720) / 720
    path = ring(0.02 + 3e-6 * np.sin(2.0 * angle), centre=(0.1, -0.2))
    result = circular(path)
    assert pytest.approx(6e-6, rel=1e-3) == result.G
    assert result.H is None
    assert result.G_b is None
    assert result.radius == pytest.approx(0.02, abs=1e-9)


def test_an_off_centre_circle_deviates_from_the_nominal_one_only() -> None:
    result = circular(ring(0.01, centre=(5e-6, 0.0)), radius=0.01, centre=(0.0, 0.0))
    assert pytest.approx(0.0, abs=1e-12) == result.G
    assert result.F_max == pytest.approx(5e-6, rel=1e-3)
    assert result.F_min == pytest.approx(-5e-6, rel=1e-3)


@settings(max_examples=15, deadline=None)
@given(
    seed=st.integers(0, 10_000),
    shift=st.tuples(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0)),
    turn=st.floats(0.0, 6.0),
)
def test_the_minimum_zone_is_smallest_and_moves_with_the_path(
    seed: int, shift: tuple[float, float], turn: float
) -> None:
    generator = np.random.default_rng(seed)
    path = ring(0.05 + generator.normal(0.0, 1e-5, 60), 60)
    width, centre = minimum_zone(path)
    distance = np.linalg.norm(path - centre, axis=1)
    assert np.ptp(distance) == pytest.approx(width, rel=1e-9)
    fitted, _ = least_squares_circle(path)
    assert width <= np.ptp(np.linalg.norm(path - fitted, axis=1)) * (1 + 1e-12)
    for step in generator.normal(0.0, 2e-6, (20, 2)):
        moved = np.linalg.norm(path - centre - step, axis=1)
        assert np.ptp(moved) >= width * (1 - 1e-6)
    rotation = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    again, _ = minimum_zone(path @ rotation.T + np.array(shift))
    assert again == pytest.approx(width, rel=1e-4)


@settings(max_examples=30, deadline=None)
@given(
    radius=st.floats(1e-4, 10.0),
    centre=st.tuples(st.floats(-5.0, 5.0), st.floats(-5.0, 5.0)),
    count=st.integers(8, 50),
)
def test_an_exact_circle_is_found(radius: float, centre: tuple[float, float], count: int) -> None:
    found, found_radius = least_squares_circle(ring(radius, count, centre))
    np.testing.assert_allclose(found, centre, atol=1e-11 + 1e-9 * radius)
    assert found_radius == pytest.approx(radius, rel=1e-9, abs=1e-11)


def test_hysteresis_fills_sectors_without_points() -> None:
    angles = 2.0 * np.pi * np.arange(360) / 360
    sparse = radius_over_angle(ring(0.01, 40), (0.0, 0.0), angles)
    np.testing.assert_allclose(sparse, 0.01, rtol=1e-12)


def test_bad_input_is_named() -> None:
    good = np.zeros((2, 3))
    for targets, up, down in (
        ([0.0, 1.0], good[:1], good),
        ([0.0, 1.0], good[:, :1], good),
        ([0.0, 1.0], good[0], good),
        ([0.0, float('nan')], good, good),
        ([], np.zeros((0, 3)), np.zeros((0, 3))),
    ):
        with pytest.raises(StageError):
            positioning(targets, up, down)
    with pytest.raises(StageError, match='8 points'):
        circular(ring(1.0, 5))
    with pytest.raises(StageError, match='finite'):
        circular(np.full((10, 2), np.nan))
    with pytest.raises(StageError, match='line'):
        circular(np.column_stack([np.arange(10.0), np.arange(10.0)]))
    with pytest.raises(StageError, match='coincide'):
        circular(np.ones((10, 2)))
    with pytest.raises(StageError, match='positive'):
        circular(ring(1.0), radius=-1.0)
    with pytest.raises(StageError, match='sectors'):
        circular(ring(1.0), ring(1.0), sectors=3)
