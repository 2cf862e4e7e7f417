"""fg-Bernstein curves computed to high relative accuracy (paper 4)."""

from hra_curves.bases import (
    Basis,
    Bernstein,
    Hyperbolic,
    Monomial,
    Rational,
    Trigonometric,
    basis_named,
)
from hra_curves.curve import HraCurve
from hra_curves.factorisation import Bidiagonal, collocation_matrix, factorise
from hra_curves.fitting import (
    HraWarning,
    chord_length_nodes,
    fit_to_tolerance,
    interpolate,
    interpolate_to_tolerance,
    least_squares_curve,
    parameter_nodes,
)
from hra_curves.solvers import (
    OrthogonalFactors,
    determinant,
    inverse,
    least_squares,
    orthogonal_factors,
    solve,
)

__all__ = [
    'Basis',
    'Bernstein',
    'Bidiagonal',
    'HraCurve',
    'HraWarning',
    'Hyperbolic',
    'Monomial',
    'OrthogonalFactors',
    'Rational',
    'Trigonometric',
    'basis_named',
    'chord_length_nodes',
    'collocation_matrix',
    'determinant',
    'factorise',
    'fit_to_tolerance',
    'interpolate',
    'interpolate_to_tolerance',
    'inverse',
    'least_squares',
    'least_squares_curve',
    'orthogonal_factors',
    'parameter_nodes',
    'solve',
]
