"""The contours, the feed and the reference against independent oracles."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from geomdl import NURBS as geomdl_nurbs
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.special import ellipe

from calibrator.model_file import StoredModel, save
from calibrator.models import make_model
from contour_ctrl import curve_file, curves, nurbs, reference
from contour_ctrl.calibration import announced_model, inverse, temperatures_line
from contour_ctrl.feedrate import AxisLimits, SCurve
from contour_ctrl.path import PathTable
from hra_curves.arc_length import ArcLength
from stage_core.errors import StageError

ALL = {
    'circle': curves.circle(0.02, (0.01, -0.02)),
    'square': curves.square(0.04, 0.005),
    'star': curves.star(0.03, 0.015, 0.002),
    'eight': curves.eight(0.06, 0.03),
    'freeform': nurbs.interpolate(
        [(0, 0), (0.03, 0.01), (0.05, 0.04), (0.02, 0.05), (-0.01, 0.02)], closed=True
    ),
}


def test_nurbs_derivatives_agree_with_geomdl() -> None:
    rng = np.random.default_rng(4)
    points = rng.uniform(-0.05, 0.05, (9, 2))
    weights = rng.uniform(0.5, 2.0, 9)
    knots = np.array([0, 0, 0, 0, 0.2, 0.4, 0.4, 0.7, 0.9, 1, 1, 1, 1])
    mine = nurbs.NurbsCurve(3, knots, points, weights)
    oracle = geomdl_nurbs.Curve()
    oracle.degree = 3
    oracle.ctrlptsw = [[x * w, y * w, w] for (x, y), w in zip(points, weights, strict=True)]
    oracle.knotvector = list(knots)
    for u in (0.0, 0.13, 0.4, 0.55, 0.98):
        expected = np.array(oracle.derivatives(u, 2))
        assert mine.derivatives(u, 2)[:, 0] == pytest.approx(expected, rel=1e-9, abs=1e-10)


def test_nurbs_circle_is_exact() -> None:
    circle = ALL['circle']
    points, first, second = circle.derivatives(np.linspace(0, 1, 333), 2)
    assert np.hypot(*(points - (0.01, -0.02)).T) == pytest.approx(0.02, rel=1e-13)
    bend = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
    assert bend / np.linalg.norm(first, axis=1) ** 3 == pytest.approx(50.0, rel=1e-9)


def test_arc_length_agrees_with_quadrature_and_with_the_ellipse() -> None:
    for name, curve in ALL.items():
        table = ArcLength.of(curve)
        breaks = curve.breaks
        expected = sum(
            quad(
                lambda u, c=curve: float(np.linalg.norm(c.derivatives(u, 1)[1, 0])),
                a,
                b,
                epsrel=1e-11,
            )[0]
            for a, b in zip(breaks[:-1], breaks[1:], strict=True)
        )
        assert table.total == pytest.approx(expected, rel=1e-8), name
    ellipse = curves.CallableCurve(
        lambda u: np.column_stack([0.05 * np.cos(u), 0.03 * np.sin(u)]), (0.0, 2 * np.pi), True
    )
    assert ArcLength.of(ellipse).total == pytest.approx(4 * 0.05 * ellipe(1 - 0.36), rel=1e-10)


@pytest.mark.parametrize('name', sorted(ALL))
def test_reference_moves_along_the_curve_at_the_feed(name: str) -> None:
    limits = AxisLimits(jerk=(1e4, 1e4))
    ref = reference.plan(ALL[name], 0.04, limits=limits)
    speed = np.linalg.norm(ref.velocity, axis=1)
    assert speed.max() == pytest.approx(0.04, rel=1e-9)
    assert speed[0] == 0.0 and speed[-1] < 1e-3
    # A chord is shorter than its arc by (curvature step)^2 / 24: nothing else may be there.
    bend = np.abs(np.diff(ref.angle)) / np.maximum(np.diff(ref.arc), 1e-9)
    chord = (bend[10:-10].max() * 4e-5) ** 2 / 24
    assert ref.fluctuation <= 1.1 * chord + 1e-8
    central = (ref.position[2:] - ref.position[:-2]) / (2 * ref.period)
    assert np.abs(central - ref.velocity[1:-1]).max() < 2e-5
    assert ref.position[-1] == pytest.approx(ref.position[0], abs=1e-9)
    assert ref.arc[-1] == pytest.approx(ref.path.length, rel=1e-12)


@settings(max_examples=40, deadline=None)
@given(
    length=st.floats(1e-4, 1.0),
    feed=st.floats(1e-3, 1.0),
    acceleration=st.floats(0.1, 20.0),
    jerk=st.floats(1.0, 1e4),
)
def test_s_curve_arrives_within_its_limits(
    length: float, feed: float, acceleration: float, jerk: float
) -> None:
    profile = SCurve.plan(length, feed, acceleration, jerk)
    t = np.linspace(0.0, profile.duration, 4001)
    s, v, a = profile.at(t)
    assert s[-1] == pytest.approx(length, rel=1e-9)
    assert v[-1] == pytest.approx(0.0, abs=1e-6 * feed)
    assert v.max() <= feed * (1 + 1e-9)
    assert np.abs(a).max() <= acceleration * (1 + 1e-9)
    assert np.abs(np.diff(a)).max() <= jerk * t[1] * (1 + 1e-6)
    ramps = [
        np.linspace(a, a + d, 50)
        for a, d in zip(
            np.cumsum(profile.durations) - profile.durations, profile.durations, strict=True
        )
    ]
    t = np.unique(np.concatenate(ramps))
    v = profile.at(t)[1]
    assert np.sum(0.5 * (v[1:] + v[:-1]) * np.diff(t)) == pytest.approx(length, rel=1e-3)


def test_laps_repeat_the_positions() -> None:
    one = reference.plan(ALL['circle'], 0.03)
    two = reference.plan(ALL['circle'], 0.03, laps=2)
    assert two.arc[-1] == pytest.approx(2 * one.arc[-1])
    radius = np.hypot(*(two.position - (0.01, -0.02)).T)
    assert radius == pytest.approx(0.02, rel=1e-9)


def test_a_feed_too_high_names_the_limit_and_the_highest_feed() -> None:
    limits = AxisLimits(acceleration=(5.0, 0.1), jerk=(1e5, 1e5))
    with pytest.raises(StageError, match=r'acceleration limit of axis y .*highest feed') as caught:
        reference.plan(ALL['circle'], 0.2, limits=limits, path_acceleration=0.05)
    highest = float(str(caught.value).split('highest feed is ')[1].split()[0])
    assert highest**2 / 0.02 == pytest.approx(0.1, rel=0.02)
    reduced = reference.plan(
        ALL['circle'], 0.2, limits=limits, path_acceleration=0.05, reduce_feed=True
    )
    assert reduced.feed == pytest.approx(highest, rel=1e-3)
    with pytest.raises(StageError, match='speed limit of axis x'):
        reference.plan(ALL['circle'], 0.03, limits=AxisLimits(speed=(0.01, 1.0)))


def test_a_search_or_a_contour_without_end_is_refused_soon() -> None:
    limits = AxisLimits(jerk=(1e-9, 1e-9))
    with pytest.raises(StageError, match='no feed of 0.03 m/s or more keeps the jerk limit of'):
        reference.plan(curves.circle(0.02), 0.03, 0.02, limits)
    with pytest.raises(StageError, match='ticks, more than 2e.06: raise feed'):
        reference.plan(curves.circle(0.02), 1e-7)


def test_bad_curves_are_refused() -> None:
    with pytest.raises(StageError, match='zero-length segment between points 2 and 3'):
        nurbs.interpolate([(0, 0), (1, 0), (1, 0), (2, 1), (3, 0), (4, 2)], closed=False)
    cusp = curves.CallableCurve(
        lambda u: np.column_stack([u**2, u**3]),
        (-1.0, 1.0),
        exact=lambda u, n: np.stack(
            [
                np.column_stack([u**2, u**3]),
                np.column_stack([2 * u, 3 * u**2]),
                np.column_stack([2 + 0 * u, 6 * u]),
            ]
        )[: n + 1],
    )
    with pytest.raises(StageError, match='cusp'):
        reference.plan(cusp, 0.01)
    corner = nurbs.NurbsCurve(1, [0, 0, 1, 2, 2], [(0, 0), (1, 0), (1, 1)])
    with pytest.raises(StageError, match='corner of 90.0 deg'):
        reference.plan(corner, 0.01)
    repeated = nurbs.NurbsCurve(1, [0, 0, 1, 2, 3, 3], [(0, 0), (1, 0), (1, 0), (2, 0)])
    with pytest.raises(StageError, match='zero-length'):
        reference.plan(repeated, 0.01)
    with pytest.raises(StageError, match='does not fit the sides'):
        curves.square(0.01, 0.02)
    with pytest.raises(StageError, match='radius'):
        curves.circle(-1.0)


def test_a_circle_goes_round_either_way() -> None:
    for clockwise, sense in ((False, 1.0), (True, -1.0)):
        plan = reference.plan(curves.circle(0.02, clockwise=clockwise), 0.03)
        turned = np.unwrap(np.arctan2(*plan.position.T[::-1]))
        assert turned[-1] - turned[0] == pytest.approx(sense * 2.0 * np.pi)
        assert (sense * np.diff(turned) > -1e-12).all()


def test_nurbs_texts() -> None:
    points = '[[0, 0], [0.01, 0.02], [0.02, 0]]'
    good = f'degree: 2\nknots: [0, 0, 0, 1, 1, 1]\ncontrol_points: {points}'
    curve = curve_file.from_text('nurbs', good, 'the curve')
    assert curve.derivatives(0.5, 0)[0, 0] == pytest.approx([0.01, 0.01])
    for text, words in (
        ('degree: 2\nknots: [0, 1]\ncontrol_points: [[0, 0], [1, 1], [2, 0]]', 'need 6 knots'),
        ('degree: 2', 'knots is missing'),
        ('degre: 2', 'did you mean degree'),
        ('a: [', 'not valid YAML'),
        ('degree: 1\nknots: [0,0,1,1]\ncontrol_points: [[0, 0], [.nan, 1]]', 'not finite'),
        ('degree: x\nknots: [0,0,1,1]\ncontrol_points: [[0, 0], [1, 1]]', 'numbers'),
    ):
        with pytest.raises(StageError, match=words):
            curve_file.from_text('nurbs', text, 'the curve')


def test_braked_reference_stops_on_the_path() -> None:
    ref = reference.plan(ALL['circle'], 0.05)
    stop, faded = ref.braked(700, 0.2, ref.velocity)
    assert faded[0] == pytest.approx(ref.velocity[700]) and np.abs(faded[-1]).max() < 1e-12
    assert stop.position[0] == pytest.approx(ref.position[700])
    assert stop.velocity[0] == pytest.approx(ref.velocity[700])
    assert np.abs(stop.velocity[-1]).max() < 1e-12
    assert np.hypot(*(stop.position - (0.01, -0.02)).T) == pytest.approx(0.02, abs=1e-7)
    moved = np.diff(stop.position, axis=0) / ref.period
    assert moved == pytest.approx(0.5 * (stop.velocity[1:] + stop.velocity[:-1]), abs=1e-5)


def test_corrected_reference_follows_the_inverse_model() -> None:
    ref = reference.plan(ALL['circle'], 0.05)
    forward = np.array([[1.001, -0.0005], [0.0, 0.999]])
    fixed = ref.corrected(lambda points: np.linalg.solve(forward, points.T).T)
    assert fixed.position @ forward.T == pytest.approx(ref.position, abs=1e-15)
    assert fixed.velocity @ forward.T == pytest.approx(ref.velocity, abs=1e-5)
    with pytest.raises(StageError, match='cannot be inverted'):
        ref.corrected(lambda points: points * np.nan)


def test_a_thermal_model_is_inverted_at_the_temperatures_heard_else_at_their_means() -> None:
    generator = np.random.default_rng(0)
    command = generator.uniform(0.0, 0.1, (200, 2))
    heat = generator.uniform(18.0, 24.0, (200, 2))
    measured = command * (1.0 + 1e-5 * (heat - 20.0))
    model = make_model('thermal').fit(command, measured, None, heat)
    stored = StoredModel(model, sensors=('screw_x', 'screw_y'))
    goals = np.array([[0.05, 0.05], [0.02, 0.08]])
    mean = heat.mean(axis=0)
    for readings, degrees in (
        ({'screw_x': 23.0, 'air': 19.0, 'screw_y': 19.0}, (23.0, 19.0)),
        ({'screw_x': 23.0}, (23.0, mean[1])),
        ({}, mean),
    ):
        table = inverse(stored, readings, {}, 1e-3)(goals) * (
            1.0 + 1e-5 * (np.array(degrees) - 20.0)
        )
        np.testing.assert_allclose(table, goals, atol=2e-9)
    both = temperatures_line(stored, {'screw_x': 23.0, 'screw_y': 19.0})
    assert both.endswith('heard now: screw_x 23.00 °C, screw_y 19.00 °C')
    one = temperatures_line(stored, {'screw_x': 23.0})
    assert f'not heard, so the mean of the training: screw_y {mean[1]:.2f} °C' in one
    assert 'heard now' not in temperatures_line(stored, {})
    # No temperature is asked of a model without sensors.
    plain = StoredModel(make_model('affine').fit(command, 1.01 * command))
    np.testing.assert_allclose(1.01 * inverse(plain, {}, {}, 1e-3)(goals), goals, atol=1e-9)
    with pytest.raises(StageError, match=r'beyond max_correction 100\.0 µm of the calibrator'):
        inverse(plain, {}, {}, 1e-4)(goals)


def test_a_file_that_changed_since_the_calibrator_took_it_corrects_no_contour(
    tmp_path: Path,
) -> None:
    command = np.random.default_rng(0).uniform(0.0, 0.1, (50, 2))
    model = make_model('affine').fit(command, 1.001 * command)
    taken = StoredModel(model, version=3, metrics={'after': {'rms': 1e-6}})
    file = tmp_path / 'model.json'
    announced = {
        'active': True,
        'file': str(file),
        'version': 3,
        'metrics': taken.metrics,
        'max_correction': 1e-3,
    }
    save(taken, file)
    assert announced_model(announced).version == 3
    for other in (
        replace(taken, version=4),
        replace(taken, metrics={'after': {'rms': 5e-5}, 'refusal': 'worse than none'}),
    ):
        save(other, file)
        with pytest.raises(StageError, match='no longer the model that the calibrator corrects'):
            announced_model(announced)
    with pytest.raises(StageError, match='must not correct: worse than none'):
        announced_model({**announced, 'metrics': other.metrics})
    with pytest.raises(StageError, match='without file: retrain'):
        announced_model({**announced, 'file': ''})
    with pytest.raises(StageError, match='without max_correction: retrain'):
        announced_model({**announced, 'max_correction': '0.001'})
    with pytest.raises(StageError, match='without file and version and metrics and max_corr'):
        announced_model({'active': True})


def test_path_table_holds_unit_tangents() -> None:
    table = PathTable.from_curve(ArcLength.of(ALL['eight']))
    assert np.linalg.norm(table.values[:, 2:4], axis=1) == pytest.approx(1.0)
    rebuilt = PathTable.from_points(table.values[:, :2], table.length, True)
    assert rebuilt.values[5:-5, 2:4] == pytest.approx(table.values[5:-5, 2:4], abs=1e-5)
