"""The closed-form factorisation: total positivity, accuracy, errors."""

from __future__ import annotations

import itertools

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hra_curves import (
    Basis,
    Bernstein,
    Hyperbolic,
    Monomial,
    Rational,
    Trigonometric,
    basis_named,
    collocation_matrix,
    exact,
    factorise,
    parameter_nodes,
)
from stage_core.errors import StageError

ALL = [
    Bernstein(),
    Bernstein(-2.0, 3.0),
    Trigonometric(1.57),
    Trigonometric(2.9),
    Hyperbolic(2.0),
    Rational(0.5, 3.0),
    Monomial(2.0),
]
UNIT = np.finfo(float).eps


@st.composite
def scattered_nodes(draw: st.DrawFn, minimum: int = 2, maximum: int = 8) -> list[float]:
    """Increasing fractions in (0, 1), some of them nearly coincident."""
    count = draw(st.integers(minimum, maximum))
    gaps = draw(st.lists(st.sampled_from([1e-9, 1e-4, 0.1, 1.0]), min_size=count, max_size=count))
    steps = np.cumsum(np.array(gaps) + 1e-12)
    return list(0.02 + 0.95 * (steps - steps[0]) / (steps[-1] - steps[0] + 1e-3))


def spread(basis: Basis, fractions: list[float]) -> np.ndarray:
    lower, upper = basis.domain
    return lower + (upper - lower) * np.array(fractions)


@pytest.mark.parametrize('basis', ALL, ids=str)
@pytest.mark.parametrize('placement', ['closed', 'interior'])
@pytest.mark.parametrize(('rows', 'degree'), [(1, 0), (2, 1), (9, 8), (15, 4), (30, 1), (6, 0)])
def test_factors_multiply_to_the_matrix(
    basis: Basis, placement: str, rows: int, degree: int
) -> None:
    nodes = parameter_nodes(basis.domain, rows, placement)
    factors = factorise(basis, nodes, degree)
    matrix = collocation_matrix(basis, nodes, degree)
    assert factors.shape == (rows, degree + 1)
    np.testing.assert_allclose(
        factors.multiply(np.eye(degree + 1)),
        matrix,
        rtol=200 * UNIT,
        atol=10 * UNIT * matrix.max(),
    )


@pytest.mark.parametrize('basis', ALL, ids=str)
@settings(max_examples=15, deadline=None)
@given(fractions=scattered_nodes(maximum=6))
def test_entries_are_nonnegative_and_so_is_every_minor(
    basis: Basis, fractions: list[float]
) -> None:
    nodes = spread(basis, fractions)
    factors = factorise(basis, nodes)
    assert (factors.entries > 0.0).all()
    table = exact.collocation(basis, nodes, nodes.size - 1)
    with mpmath.workdps(exact.DIGITS):
        for order in (2, 3):
            picks = list(itertools.combinations(range(nodes.size), order))
            for rows, columns in itertools.product(picks[:6], picks[-6:]):
                minor = mpmath.matrix([[table[i][j] for j in columns] for i in rows])
                assert mpmath.det(minor) > 0


@pytest.mark.parametrize('basis', ALL, ids=str)
@settings(max_examples=15, deadline=None)
@given(fractions=scattered_nodes())
def test_pivots_agree_with_exact_elimination(basis: Basis, fractions: list[float]) -> None:
    nodes = spread(basis, fractions)
    table = exact.collocation(basis, nodes, nodes.size - 1)
    pivots = np.diagonal(factorise(basis, nodes).entries)
    with mpmath.workdps(exact.DIGITS):
        before = mpmath.mpf(1)
        for size in range(1, nodes.size + 1):
            leading = mpmath.det(mpmath.matrix([row[:size] for row in table[:size]]))
            assert abs(pivots[size - 1] * before / leading - 1) < 100 * size * UNIT
            before = leading


@settings(max_examples=60, deadline=None)
@given(
    basis=st.sampled_from(ALL),
    lower=st.floats(0.001, 0.99),
    gap=st.sampled_from([1e-14, 1e-9, 1e-3, 0.5]),
)
def test_differences_hold_for_nearly_coincident_nodes(
    basis: Basis, lower: float, gap: float
) -> None:
    first, second = spread(basis, [lower, min(lower + gap, 0.999)])
    if second <= first:
        return
    computed = basis.differences(np.array([second]), np.array([first]))[0]
    with mpmath.workdps(exact.DIGITS):
        assert abs(computed / exact.difference(basis, second, first) - 1) < 8 * UNIT


def test_the_naive_trigonometric_difference_is_what_the_closed_form_avoids() -> None:
    basis = Trigonometric(1.57)
    low, high = np.array([0.3]), np.array([0.3 + 1e-9])
    (f_low, g_low), (f_high, g_high) = basis.pair(low), basis.pair(high)
    naive = f_high * g_low - f_low * g_high
    assert abs(naive[0] / basis.differences(high, low)[0] - 1.0) > 1e-9


@pytest.mark.parametrize('basis', ALL, ids=str)
def test_taylor_coefficients_are_the_derivatives(basis: Basis) -> None:
    points = spread(basis, [0.1, 0.55, 0.8])
    f, g = basis.taylor(points, 4)
    with mpmath.workdps(40):
        for row, point in enumerate(points):
            for part, series in enumerate((f, g)):
                reference = mpmath.taylor(
                    lambda t, part=part: basis.pair(t, mpmath)[part], mpmath.mpf(point), 4
                )
                np.testing.assert_allclose(
                    series[row], [float(value) for value in reference], rtol=1e-12, atol=1e-14
                )


@pytest.mark.parametrize(
    ('nodes', 'part'),
    [
        ([0.1, 0.1, 0.2], 'repeats'),
        ([0.2, 0.1], 'sort'),
        ([0.1, 1.5], 'domain'),
        ([-0.1, 0.5], 'domain'),
        ([0.1, float('nan')], 'node 1'),
        ([0.1, float('inf')], 'finite'),
        ([], 'too few'),
        ([[0.1, 0.2]], 'list'),
    ],
)
def test_bad_nodes_are_named(nodes: list[float], part: str) -> None:
    with pytest.raises(StageError, match=part):
        factorise(Bernstein(), nodes)


@pytest.mark.parametrize('degree', [3, -1, 5000])
def test_bad_degrees_are_named(degree: int) -> None:
    with pytest.raises(StageError, match='degree'):
        factorise(Bernstein(), [0.1, 0.2, 0.3], degree)


def test_pivots_beyond_double_precision_are_refused() -> None:
    with pytest.raises(StageError, match='double precision'):
        factorise(Bernstein(), 0.5 + 1e-9 * np.arange(60))


@pytest.mark.parametrize(
    'make',
    [
        lambda: Bernstein(1.0, 1.0),
        lambda: Bernstein(0.0, float('nan')),
        lambda: Trigonometric(3.2),
        lambda: Trigonometric(0.0),
        lambda: Hyperbolic(-1.0),
        lambda: Rational(0.0, 1.0),
        lambda: Monomial(-1.0),
        lambda: basis_named('spline'),
    ],
)
def test_bad_bases_are_refused(make: object) -> None:
    with pytest.raises(StageError):
        make()  # type: ignore[operator]


@pytest.mark.parametrize(
    'name', ['bernstein', 'trigonometric', 'hyperbolic', 'rational', 'monomial']
)
def test_bases_are_found_by_name(name: str) -> None:
    assert type(basis_named(name)).__name__.lower() == name
