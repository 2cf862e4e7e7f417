"""The alignment of the tracker's frame with the stage's."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from stage_core.errors import StageError
from tracker_bridge.registration import fit_planar, register


def test_registration_against_scipy():
    random = np.random.default_rng(4)
    rotation = Rotation.from_euler('zyx', [2.4, 0.03, -0.02])
    shift = np.array([1.5, -0.7, 0.3])
    stage = np.column_stack([random.uniform(-0.05, 0.05, (30, 2)), np.zeros(30)])
    tracker = rotation.inv().apply(stage - shift) + 2e-6 * random.standard_normal((30, 3))
    result = register(tracker, stage)
    oracle, _ = Rotation.align_vectors(stage - stage.mean(axis=0), tracker - tracker.mean(axis=0))
    assert np.allclose(result.transform.rotation, oracle.as_matrix(), atol=1e-10)
    expected = stage.mean(axis=0) - oracle.apply(tracker.mean(axis=0))
    assert np.allclose(result.transform.translation, expected, atol=1e-9)
    assert result.rms == pytest.approx(np.sqrt(3) * 2e-6, rel=0.3)
    # Eq. 24: Tr maps stage points to the tracker's plane.
    planar = fit_planar(stage, tracker)
    assert np.allclose(stage[:, :2] @ planar[:, :2].T + planar[:, 2], tracker[:, :2], atol=1e-5)
    assert result.planar_rms <= result.rms
    assert '30 rests' in result.summary()


def test_stated_uncertainty_is_the_scatter_of_repetitions():
    random = np.random.default_rng(7)
    x, y = np.meshgrid(np.linspace(-0.04, 0.04, 4), np.linspace(-0.03, 0.03, 3))
    stage = np.column_stack([x.ravel(), y.ravel(), np.zeros(12)])
    angles, stated = [], []
    for _ in range(300):
        result = register(stage + 1e-6 * random.standard_normal(stage.shape), stage)
        angles.append(Rotation.from_matrix(result.transform.rotation).as_rotvec())
        stated.append(result.rotation_std)
    ratio = np.std(angles, axis=0) / np.sqrt(np.mean(np.square(stated), axis=0))
    assert np.all(np.abs(ratio - 1.0) < 0.15)


@pytest.mark.parametrize('count', [0, 1, 2])
def test_too_few_rests_are_refused(count):
    with pytest.raises(StageError, match=f'only {count} rests.*align again'):
        register(np.zeros((count, 3)), np.zeros((count, 3)))


@pytest.mark.parametrize('unit', [1e-3, 1e3, 1e6, 1 / 0.0254])
def test_points_in_another_unit_are_refused(unit):
    stage = np.random.default_rng(0).uniform(-0.05, 0.05, (8, 3)) * [1, 1, 0]
    tracker = Rotation.from_euler('z', 70, degrees=True).apply(stage) + [1.0, 2.0, 0.5]
    assert register(tracker, stage).rms < 1e-9
    with pytest.raises(StageError, match='as far as the stage: .*unit'):
        register(unit * tracker, stage)


def test_points_that_do_not_follow_the_stage_are_refused():
    rng = np.random.default_rng(0)
    stage = rng.uniform(-0.05, 0.05, (8, 3)) * [1, 1, 0]
    with pytest.raises(StageError, match='does not follow the stage .*reflector'):
        register(rng.uniform(-0.05, 0.05, (8, 3)), stage)


def test_rests_on_one_line_are_refused():
    line = np.outer(np.linspace(-0.05, 0.05, 9), [1.0, 0.5, 0.0])
    with pytest.raises(StageError, match='one line'):
        register(line, line)
