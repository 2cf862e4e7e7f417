"""What high relative accuracy and the basis are each worth."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from hra_curves import exact
from hra_curves.bases import Basis, Bernstein, Trigonometric
from hra_curves.cycloid import cycloid
from hra_curves.factorisation import collocation_matrix, factorise
from hra_curves.fitting import HraWarning, interpolate, least_squares_curve, parameter_nodes
from hra_curves.solvers import least_squares, solve
from hra_curves.tables import MICRO, TURN, hra_cycloid, least_squares_error
from stage_core.arrays import Array


@dataclass(frozen=True)
class Comparison:
    """One case of the table of worth; ``results`` maps a method to its error in ``unit``.

    ``winner`` is empty where one method meets several circumstances.
    """

    case: str
    unit: str
    results: dict[str, float]
    winner: str


def _coefficient_errors(basis: Basis, nodes: Array, values: Array) -> dict[str, float]:
    degree = nodes.size - 1
    true = exact.solve(exact.collocation(basis, nodes, degree), values)
    try:
        plain = np.linalg.solve(collocation_matrix(basis, nodes, degree), values)
        plain_error = exact.relative_error(plain, true)
    except np.linalg.LinAlgError:
        plain_error = math.inf
    accurate = solve(factorise(basis, nodes), values)
    return {'plain solve': plain_error, 'HRA': exact.relative_error(accurate, true)}


def _least_squares_errors(rows: int, control: int, values: Array) -> dict[str, float]:
    basis = Bernstein()
    nodes = parameter_nodes(basis.domain, rows, 'interior')
    true = exact.least_squares(exact.collocation(basis, nodes, control - 1), values)
    matrix = collocation_matrix(basis, nodes, control - 1)
    plain = np.linalg.lstsq(matrix, values, rcond=None)[0]
    accurate, _ = least_squares(factorise(basis, nodes, control - 1), values)
    return {
        'lstsq': exact.relative_error(plain, true),
        'TNQR': exact.relative_error(accurate, true),
    }


def _difference_errors(basis: Basis, gap: float) -> dict[str, float]:
    """Relative errors of f_i g_k - f_k g_i at two nodes ``gap`` apart."""
    low, high = 0.3, 0.3 + gap
    true = [[exact.difference(basis, high, low)]]
    (f_low, g_low), (f_high, g_high) = basis.pair(low), basis.pair(high)
    naive = np.array([[f_high * g_low - f_low * g_high]])
    closed = np.array([basis.differences(np.array([high]), np.array([low]))])
    return {
        'as written': exact.relative_error(naive, true),
        'closed form': exact.relative_error(closed, true),
    }


def _winner(results: dict[str, float]) -> str:
    best = min(results.values())
    names = [name for name, value in results.items() if value <= 3.0 * best]
    return 'no difference' if len(names) == len(results) else ' and '.join(names)


def _cycloid_curves(count: int) -> dict[str, float]:
    """Errors of curves through ``count`` points of the cycloid, micrometres."""
    theta = np.linspace(0.0, TURN, count)
    fine = np.linspace(0.0, TURN, 2001)
    nodes = parameter_nodes((0.0, 1.0), count)
    matrix = collocation_matrix(Bernstein(), nodes, count - 1)
    control = np.linalg.solve(matrix, cycloid(theta))
    plain = collocation_matrix(Bernstein(), fine / TURN, count - 1) @ control

    def error(values: Array) -> float:
        return float(np.linalg.norm(values - cycloid(fine), axis=1).max()) * MICRO

    return {
        'plain solve': error(plain),
        'HRA': error(hra_cycloid(cycloid(theta), Bernstein()).evaluate(fine)),
        'cubic spline': error(CubicSpline(theta, cycloid(theta))(fine)),
    }


def _runge(x: Array) -> Array:
    """Runge's function drawn 20 mm wide and 10 mm high, metres."""
    return np.column_stack([0.01 * x, 0.01 / (1.0 + 25.0 * x**2)])


def _runge_curves(count: int) -> dict[str, float]:
    basis = Bernstein(-1.0, 1.0)
    fine = np.linspace(-1.0, 1.0, 2001)

    def error(evaluate: Callable[[Array], Array]) -> float:
        return float(np.abs(evaluate(fine) - _runge(fine)).max()) * MICRO

    even = parameter_nodes(basis.domain, count)
    good = parameter_nodes(basis.domain, count, 'chebyshev')
    with warnings.catch_warnings():
        warnings.simplefilter('ignore', HraWarning)
        equal = interpolate(_runge(even), basis, even)
        chebyshev = interpolate(_runge(good), basis, good)
    fitted = least_squares_curve(_runge(even), max(count // 3, 5), basis, even)
    return {
        'HRA equal nodes': error(equal.evaluate),
        'HRA Chebyshev nodes': error(chebyshev.evaluate),
        'HRA least squares': error(fitted.evaluate),
        'cubic spline': error(CubicSpline(even, _runge(even))),
    }


def worth(seed: int = 3) -> list[Comparison]:
    """Cases in which the basis, the accuracy or neither makes the difference."""
    generator = np.random.default_rng(seed)
    rows: list[tuple[str, str, dict[str, float]]] = []
    for count in (11, 16, 21, 51):
        rows.append((f'cycloid, {count} points: curve error', 'µm', _cycloid_curves(count)))
    rows += [(case, 'relative', found) for case, found in _accuracies(generator)]
    for count in (21, 41):
        rows.append((f'Runge drawing, {count} points: curve error', 'µm', _runge_curves(count)))
    comparisons = [
        Comparison(case, unit, results, _winner(results)) for case, unit, results in rows
    ]
    for control, parity in ((14, 'odd'), (15, 'even')):
        errors = {
            f'origin {offset * 1e3:g} mm away': MICRO
            * least_squares_error(Trigonometric(), 501, control, offset)
            for offset in (0.0, 1e-3, 50e-3)
        }
        case = f'LSB2, l+1=501, n+1={control} ({parity} degree): curve error'
        comparisons.append(Comparison(case, 'µm', errors, ''))
    return comparisons


def _accuracies(generator: np.random.Generator) -> list[tuple[str, dict[str, float]]]:
    """Relative errors of computed control points, by case."""
    basis, trigonometric = Bernstein(), Trigonometric()
    rows = []
    for size in (20, 50):
        nodes = parameter_nodes(basis.domain, size, 'interior')
        smooth = cycloid(parameter_nodes((0.0, TURN), size, 'interior'))
        signs = (-1.0) ** np.arange(size)[:, None]
        alternating = signs * generator.uniform(size=(size, 1))
        for kind, values in (('smooth', smooth), ('alternating', alternating)):
            case = f'control points, {size} {kind} data'
            rows.append((case, _coefficient_errors(basis, nodes, values)))
    for case, one in (
        ('control points, 6 pairs of nodes 1e-9 apart', basis),
        ('the same, trigonometric', trigonometric),
    ):
        base = parameter_nodes(one.domain, 6, 'interior')
        pairs = np.sort(np.concatenate([base, base + 1e-9]))
        values = generator.uniform(size=(12, 1))
        rows.append((case, _coefficient_errors(one, pairs, values)))
    case = 'f_i g_k - f_k g_i, trigonometric, nodes 1e-9 apart'
    rows.append((case, _difference_errors(trigonometric, 1e-9)))
    for control in (15, 30):
        case = f'least squares, 60 random data, {control} control points'
        values = generator.uniform(size=(60, 1))
        rows.append((case, _least_squares_errors(60, control, values)))
    return rows
