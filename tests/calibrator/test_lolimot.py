"""LOLIMOT against the numbers that paper 5 prints, and its own properties."""

import numpy as np
import pytest

from calibrator.lolimot import grow, halves
from stage_core.errors import StageError

# Eq. 11c of paper 5, columns slope and offset.
PRINTED = [[-0.0470, 0.0295], [-0.0285, 0.0250], [-0.0137, 0.0173]]
EDGES = [0.0, 0.25, 0.5, 1.0]


def example(samples=2001):
    u = np.linspace(0.0, 1.0, samples)[:, None]
    return u, 0.03 * np.exp(-2.0 * u[:, 0])


def test_weights_of_the_paper_to_every_printed_digit():
    u, y = example()
    tree = grow(u, y, models=3, overlap=0.1, penalty=None)[-1]
    np.testing.assert_array_equal(np.round(tree.weights[:, ::-1], 4), PRINTED)
    np.testing.assert_allclose([*tree.low[:, 0], tree.high[-1, 0]], EDGES)


def test_first_steps_of_the_paper_are_not_those_of_any_fit():
    # (11a) and (11b) print the first rows of (11c); the true fits differ in the second digit.
    u, y = example()
    trees = grow(u, y, models=3, overlap=0.1, penalty=None)
    np.testing.assert_allclose(trees[0].weights[0, ::-1], [-0.0244, 0.0252], atol=5e-5)
    np.testing.assert_allclose(
        trees[1].weights[:, ::-1], [[-0.0373, 0.0283], [-0.0137, 0.0173]], atol=5e-5
    )


def test_validity_sums_to_one_also_far_away():
    u, y = example()
    tree = grow(u, y, models=5, overlap=0.2, penalty=None)[-1]
    np.testing.assert_allclose(tree.validity([[-50.0], [0.3], [99.0]]).sum(axis=1), 1.0)


def test_a_plane_needs_one_model_and_a_kink_more():
    generator = np.random.default_rng(0)
    u = generator.uniform(-1, 1, (400, 2))
    noise = generator.normal(0, 1e-3, 400)
    plane = grow(u, 1.0 + u @ [2.0, -3.0] + noise)
    assert len(plane) == 1
    np.testing.assert_allclose(plane[0].weights, [[1.0, 2.0, -3.0]], atol=1e-3)
    kink = grow(u, np.abs(u[:, 0]) + noise, overlap=0.1)
    assert 2 <= len(kink[-1].low) <= 15
    np.testing.assert_allclose(sorted(kink[1].low[:, 0]), [-1.0, 0.0], atol=0.02)


def test_splitting_all_is_never_worse_per_step():
    u, y = example(501)
    worst = grow(u, y, models=4, overlap=0.1, penalty=None)
    every = grow(u, y, models=4, overlap=0.1, split_all=True, penalty=None)
    for a, b in zip(worst[:2], every[:2], strict=True):
        assert np.mean((b.predict(u) - y) ** 2) <= np.mean((a.predict(u) - y) ** 2) + 1e-18


def test_halves_tile_the_cell():
    low, high = halves(np.array([[0.0, 0.0]]), np.array([[2.0, 4.0]]), 0, 1)
    np.testing.assert_array_equal(low, [[0, 0], [0, 2]])
    np.testing.assert_array_equal(high, [[2, 2], [2, 4]])
    with pytest.raises(StageError, match='too few'):
        grow(np.zeros((2, 2)), np.zeros(2))
