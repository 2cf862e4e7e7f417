"""What a force balance leaves once its own past is taken out: the innovations of a fit.

The recorded force answers to the encoder's noise through the controller, and the rows of the
force balance hold that noise, too. So a column that is nearly the slope of the force (a delay, a
lag) takes part of the controller's answer for the plant's. In closed loop the fit has no such
bias where the rows are freed of all that their past tells of them: the prediction-error method
with a noise model that is estimated, too (Forssell and Ljung, Automatica 35, 1999).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_toeplitz

from gap_diagnosis.residuals.problem import Problem
from gap_diagnosis.residuals.regression import Fit, Regression
from gap_diagnosis.residuals.servo import Servo
from stage_twin.effects.term import Term

Array = NDArray[np.float64]

MEMORY = 0.04  # s; at 0.012 s the noise of 1.6 µm of an encoder still tells a lag for a delay
ROUNDS = 2  # of noise model and fit, from parameters that are nearly right


def innovations(rows: Servo, fit: Fit) -> tuple[Problem, Fit]:
    """A set of effects fitted to the innovations of the rows, and the problem of these rows."""
    free = rows.unlimited()
    plain = with_shapes(free.problem(), fit)
    problem, found = plain, fit
    for _ in range(ROUNDS):
        residual = Regression(plain).linear(found.thetas).residual
        problem = with_shapes(free.whitened(_prediction_error(free, residual)).problem(), fit)
        found = Regression(problem).refine(found.thetas, list(found.thetas))
    return problem, found


def with_shapes(problem: Problem, fit: Fit) -> Problem:
    """The problem with its terms as rich as they are in a fit."""
    for name, theta in fit.thetas.items():
        term = problem.terms[name]
        while not _fits(term, theta, len(fit.coefficients[name])) and term.next is not None:
            term = term.next
        problem.terms[name] = term
    return problem


def _fits(term: Term, theta: tuple[float, ...], count: int) -> bool:
    return len(term.lower) == len(theta) and term.columns(theta).shape[1] == count


def _prediction_error(rows: Servo, residual: Array) -> Array:
    """Filter (k,) from a residual to what its past does not tell: autoregressive, Yule-Walker.

    The residual (n,) holds the sliding rows alone: only pairs of ticks count that both do.
    """
    order = int(round(MEMORY / rows.periods[0]))
    ticks = np.concatenate([np.flatnonzero(k) for k in rows.keep])
    covariance = np.empty(order + 1)
    for lag in range(order + 1):
        pairs = ticks[lag:] - ticks[: len(ticks) - lag] == lag
        products = residual[lag:] * residual[: len(residual) - lag]
        covariance[lag] = products[pairs].mean()
    covariance[0] *= 1.0 + 1e-9  # solvable where the residual is a pure oscillation
    return np.concatenate([[1.0], -solve_toeplitz(covariance[:-1], covariance[1:])])
