"""Distinct places, wild samples, and the rule by which a model is taken."""

import numpy as np
import pytest

from calibrator.gain import held_out_gain
from calibrator.outliers import wild
from calibrator.places import distinct_places, folds, judged_places


@pytest.mark.parametrize('axes', [1, 2])
@pytest.mark.parametrize('scatter', [0.0, 1e-9, 2e-6])
def test_repeats_are_one_place_whatever_their_scatter(axes, scatter):
    generator = np.random.default_rng(axes)
    places = generator.permutation(np.linspace(0.0, 0.05, 40))[:, None]
    places = np.hstack([places, generator.uniform(0.0, 0.05, (40, axes - 1))])
    visits = np.tile(places, (3, 1)) + generator.normal(0.0, scatter, (120, axes))
    labels = distinct_places(visits)
    np.testing.assert_array_equal(labels, np.tile(labels[:40], 3))
    assert sorted(labels[:40]) == list(range(40))


def test_points_that_never_repeat_are_all_places_and_paths_are_cells():
    grid = np.random.default_rng(0).uniform(0.0, 0.1, (200, 2))
    assert len(np.unique(distinct_places(grid))) >= 199
    turn = np.linspace(0.0, 2.0 * np.pi, 4000)
    circle = 0.1 * np.column_stack([np.cos(turn), np.sin(turn)])
    assert 40 < len(np.unique(judged_places(circle))) < 120
    # A lap at 100 Hz is a path, too.
    assert len(np.unique(distinct_places(circle[::3]))) > 1300


def test_folds_leave_whole_places_out_once():
    labels = np.repeat(np.arange(7), 5)
    masks = folds(labels, 3)
    assert (np.sum(masks, axis=0) == 1).all()
    assert all(not set(labels[m]) & set(labels[~m]) for m in masks)


def test_the_interval_covers_the_true_gain_and_repeats_do_not_narrow_it():
    generator = np.random.default_rng(1)
    inside = 0
    for draw in range(200):
        before = generator.normal(0.0, 2.0, (30, 2))
        after = generator.normal(0.0, 1.0, (30, 2))
        gain = held_out_gain(before, after, np.arange(30), draw)
        inside += gain.low <= 0.5 <= gain.high
    # 95 % of the percentile interval's theory; 30 places lose some of it.
    assert inside >= 175
    places = np.repeat(np.arange(30), 10)
    repeated = held_out_gain(before.repeat(10, axis=0), after.repeat(10, axis=0), places, 199)
    assert (repeated.low, repeated.high) == pytest.approx((gain.low, gain.high))
    assert repeated.places == 30
    assert not held_out_gain(np.zeros((9, 1)), np.zeros((9, 1)), np.arange(9)).proven


def test_wild_samples_are_found_and_a_curved_stage_is_not():
    generator = np.random.default_rng(2)
    command = generator.uniform(0.0, 0.05, (300, 2))
    error = np.column_stack([1e-3 * command[:, 0], 0.05 * (command[:, 1] - 0.02) ** 2])
    error += generator.normal(0.0, 3e-7, error.shape)
    assert not wild(command, error).any()
    error[[5, 70, 200], 1] += 1e-3
    assert np.flatnonzero(wild(command, error)).tolist() == [5, 70, 200]
    error[:30, 0] += 1e-3
    assert not wild(command, error).any()
