"""Examples I and II of paper 5."""

import numpy as np
import pytest

from benchmarks.paper5_examples import calibrate, constraint, grow_calibration, jacobian, poses
from calibrator.lolimot import LocalLinearTree
from stage_core.errors import StageError

WEIGHTS = np.array([[0.0295, -0.0470], [0.0250, -0.0285], [0.0173, -0.0137]])
LOW, HIGH = np.array([[0.0], [0.25], [0.5]]), np.array([[0.25], [0.5], [1.0]])


@pytest.mark.parametrize('overlap', [0.1, 0.33])
def test_example_one_is_recovered_to_round_off(overlap):
    planted = LocalLinearTree(LOW, HIGH, WEIGHTS, overlap)
    steps = grow_calibration(poses(lambda s: planted.predict(s[:, None])), overlap=overlap)
    assert len(steps) == 3
    np.testing.assert_allclose(steps[-1].guide.low, LOW)
    np.testing.assert_allclose(steps[-1].guide.weights, WEIGHTS, atol=1e-13)
    np.testing.assert_allclose([steps[-1].x_p, steps[-1].length], [0.2, 1.0], atol=1e-14)
    errors = [step.discrepancy for step in steps]
    assert errors[0] > errors[1] > 1e3 * errors[2]
    assert errors[2] < 1e-13


def test_example_two_follows_an_unknown_guide():
    def guide(s):
        return 0.03 * np.exp(-2.0 * s)

    steps = grow_calibration(poses(guide, noise=2e-4))
    assert 3 <= len(steps) <= 8
    s = np.linspace(0.05, 0.95, 50)
    assert np.abs(steps[-1].guide.predict(s[:, None]) - guide(s)).max() < 1e-3
    assert abs(steps[-1].length - 1.0) < 2e-4


def test_jacobian_equals_differences():
    data = poses(lambda s: 0 * s, count=7)
    found = jacobian(data, LOW, HIGH, 0.2)
    d = np.random.default_rng(1).normal(size=8)

    def f(d):
        return constraint(data, d[0], d[1], LocalLinearTree(LOW, HIGH, d[2:].reshape(3, 2), 0.2))

    for k in range(8):
        step = np.zeros(8)
        step[k] = 1e-6
        np.testing.assert_allclose(found[:, k], (f(d + step) - f(d - step)) / 2e-6, atol=1e-8)


def test_too_few_poses_are_named():
    with pytest.raises(StageError, match='3 poses are too few for 8'):
        calibrate(poses(lambda s: 0 * s, count=3), LOW, HIGH, 0.1)
