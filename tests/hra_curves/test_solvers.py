"""Solving, inverting and least squares from the factorisation, against 100 digits."""

from __future__ import annotations

import math

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hra_curves import (
    Basis,
    Bernstein,
    Bidiagonal,
    collocation_matrix,
    determinant,
    exact,
    factorise,
    inverse,
    kernels,
    least_squares,
    orthogonal_factors,
    parameter_nodes,
    solve,
)
from stage_core.errors import StageError

from .test_curves import ALL


def componentwise_error(computed: np.ndarray, exact_table: list[list[mpmath.mpf]]) -> float:
    """Largest relative error of a component."""
    pairs = zip(computed.ravel(), (true for row in exact_table for true in row), strict=True)
    with mpmath.workdps(exact.DIGITS):
        return max(float(abs(mpmath.mpf(float(value)) / true - 1)) for value, true in pairs)


@pytest.mark.parametrize('size', [10, 25, 50])
def test_random_systems_are_solved_to_rounding_where_a_plain_solve_fails(size: int) -> None:
    basis = Bernstein()
    nodes = parameter_nodes(basis.domain, size, 'interior')
    values = np.random.default_rng(size).uniform(size=(size, 3))
    true = exact.solve(exact.collocation(basis, nodes, size - 1), values)
    accurate = exact.relative_error(solve(factorise(basis, nodes), values), true)
    assert accurate < 1e-14
    plain = np.linalg.solve(collocation_matrix(basis, nodes, size - 1), values)
    assert exact.relative_error(plain, true) > 10.0 * accurate
    if size == 50:
        assert exact.relative_error(plain, true) > 0.5


@pytest.mark.parametrize('basis', ALL, ids=str)
@settings(max_examples=20, deadline=None)
@given(data=st.data())
def test_alternating_data_give_every_component_accurately(
    basis: Basis, data: st.DataObject
) -> None:
    size = data.draw(st.integers(2, 10))
    gaps = data.draw(
        st.lists(st.sampled_from([1e-8, 1e-3, 0.3, 1.0]), min_size=size, max_size=size)
    )
    steps = np.cumsum(gaps)
    lower, upper = basis.domain
    nodes = lower + (upper - lower) * (0.01 + 0.97 * steps / steps[-1])
    magnitudes = data.draw(st.lists(st.floats(0.01, 10.0), min_size=size, max_size=size))
    values = np.array(magnitudes)[:, None] * (-1.0) ** np.arange(size)[:, None]
    true = exact.solve(exact.collocation(basis, nodes, size - 1), values)
    assert componentwise_error(solve(factorise(basis, nodes), values), true) < 1e-13


@pytest.mark.parametrize('basis', ALL, ids=str)
def test_the_inverse_is_accurate_in_every_entry(basis: Basis) -> None:
    nodes = parameter_nodes(basis.domain, 14, 'interior')
    true = exact.solve(exact.collocation(basis, nodes, 13), np.eye(14))
    result = inverse(factorise(basis, nodes))
    assert componentwise_error(result, true) < 5e-14
    signs = np.sign(result)
    i, j = np.indices(signs.shape)
    np.testing.assert_array_equal(signs, (-1.0) ** (i + j))


@pytest.mark.parametrize('basis', ALL, ids=str)
def test_the_determinant_is_accurate(basis: Basis) -> None:
    nodes = parameter_nodes(basis.domain, 12, 'interior')
    value, logarithm = determinant(factorise(basis, nodes))
    with mpmath.workdps(exact.DIGITS):
        true = mpmath.det(mpmath.matrix(exact.collocation(basis, nodes, 11)))
        assert abs(value / true - 1) < 1e-13
        assert logarithm == pytest.approx(float(mpmath.log(true)), abs=1e-11)


def test_a_determinant_below_the_range_keeps_its_logarithm() -> None:
    value, logarithm = determinant(
        factorise(Bernstein(), parameter_nodes((0.0, 1.0), 60, 'interior'))
    )
    assert value == 0.0
    assert math.isfinite(logarithm)
    assert logarithm < -745.0


@pytest.mark.parametrize('basis', ALL, ids=str)
@pytest.mark.parametrize(('rows', 'degree'), [(3, 2), (8, 0), (9, 8), (25, 6), (40, 11)])
@pytest.mark.parametrize('placement', ['closed', 'interior'])
def test_qr_is_orthogonal_triangular_and_multiplies_back(
    basis: Basis, rows: int, degree: int, placement: str
) -> None:
    nodes = parameter_nodes(basis.domain, rows, placement)
    factors = orthogonal_factors(factorise(basis, nodes, degree))
    matrix = collocation_matrix(basis, nodes, degree)
    turned, reduced = np.eye(rows), matrix.copy()
    for vectors in (turned, reduced):
        kernels.rotate_vectors(factors.cosines, factors.sines, vectors)
    q = turned.T[:, : degree + 1]
    r = Bidiagonal(np.ascontiguousarray(factors.upper.entries[: degree + 1])).multiply(
        np.eye(degree + 1)
    )
    scale = np.abs(matrix).max()
    np.testing.assert_allclose(q @ r, matrix, atol=2e-14 * scale)
    np.testing.assert_allclose(q.T @ q, np.eye(degree + 1), atol=1e-14)
    assert (np.tril(r, -1) == 0.0).all()
    assert (np.diagonal(r) > 0.0).all()
    assert (factors.upper.entries >= 0.0).all()
    np.testing.assert_allclose(reduced[: degree + 1], r, atol=2e-14 * scale)


def test_the_triangular_factor_is_accurate_where_householder_is_not() -> None:
    basis = Bernstein()
    size = 24
    nodes = parameter_nodes(basis.domain, size, 'interior')
    diagonal = np.diagonal(orthogonal_factors(factorise(basis, nodes)).upper.entries)
    plain = np.abs(np.diagonal(np.linalg.qr(collocation_matrix(basis, nodes, size - 1))[1]))
    with mpmath.workdps(exact.DIGITS):
        matrix = mpmath.matrix(exact.collocation(basis, nodes, size - 1))
        # Cholesky of A^T A in 100 digits has the diagonal of R.
        true = mpmath.cholesky(matrix.T * matrix)
        errors = [float(abs(diagonal[i] / true[i, i] - 1)) for i in range(size)]
        plain_errors = [float(abs(plain[i] / true[i, i] - 1)) for i in range(size)]
    assert max(errors) < 1e-13
    assert max(plain_errors) > 1e4 * max(errors)


@pytest.mark.parametrize('basis', ALL, ids=str)
@settings(max_examples=15, deadline=None)
@given(rows=st.integers(6, 40), degree=st.integers(0, 5), seed=st.integers(0, 1000))
def test_least_squares_agrees_with_the_exact_one(
    basis: Basis, rows: int, degree: int, seed: int
) -> None:
    nodes = parameter_nodes(basis.domain, rows, 'interior')
    values = np.random.default_rng(seed).normal(size=(rows, 2))
    coefficients, norms = least_squares(factorise(basis, nodes, degree), values)
    true = exact.least_squares(exact.collocation(basis, nodes, degree), values)
    assert exact.relative_error(coefficients, true) < 1e-11
    fitted = collocation_matrix(basis, nodes, degree) @ np.array(true, dtype=float)
    np.testing.assert_allclose(
        norms, np.linalg.norm(values - fitted, axis=0), rtol=1e-9, atol=1e-11
    )


@pytest.mark.parametrize('basis', ALL, ids=str)
def test_least_squares_is_accurate_where_lstsq_is_not(basis: Basis) -> None:
    nodes = parameter_nodes(basis.domain, 40, 'interior')
    values = np.random.default_rng(8).uniform(size=(40, 2))
    true = exact.least_squares(exact.collocation(basis, nodes, 20), values)
    accurate, _ = least_squares(factorise(basis, nodes, 20), values)
    matrix = collocation_matrix(basis, nodes, 20)
    plain = np.linalg.lstsq(matrix, values, rcond=None)[0]
    error = exact.relative_error(accurate, true)
    assert error < 1e-12
    assert exact.relative_error(plain, true) > 10.0 * error


def test_a_vector_and_a_table_of_data_agree() -> None:
    nodes = parameter_nodes((0.0, 1.0), 9, 'interior')
    values = np.random.default_rng(2).normal(size=9)
    square, tall = factorise(Bernstein(), nodes), factorise(Bernstein(), nodes, 3)
    np.testing.assert_array_equal(solve(square, values), solve(square, values[:, None])[:, 0])
    coefficients, norm = least_squares(tall, values)
    assert coefficients.shape == (4,)
    assert norm.shape == ()


def test_bad_data_are_named() -> None:
    square = factorise(Bernstein(), [0.1, 0.5, 0.7])
    with pytest.raises(StageError, match='one row for each node'):
        solve(square, [1.0, 2.0])
    with pytest.raises(StageError, match='row 1'):
        solve(square, [1.0, float('nan'), 2.0])
    with pytest.raises(StageError, match='not square'):
        solve(factorise(Bernstein(), [0.1, 0.5, 0.7], 1), [1.0, 2.0, 3.0])
