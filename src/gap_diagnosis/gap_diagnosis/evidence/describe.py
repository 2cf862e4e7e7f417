"""The parameters of accepted effects with their standard deviations."""

from __future__ import annotations

import math

import numpy as np

from gap_diagnosis.evidence.calibrated import SPREAD
from gap_diagnosis.residuals.regression import Regression, Theta
from gap_diagnosis.selection.model import Selection
from stage_twin.effects import effect_of, link_of


def describe(
    selection: Selection, regression: Regression
) -> dict[str, dict[str, tuple[float, float]]]:
    """Parameters of each accepted effect as (value, standard deviation).

    The deviations of parameters that are functions of coefficients follow by propagation with
    central differences.
    """
    terms = regression.problem.terms
    deviations = regression.uncertainty(selection.fit)
    out: dict[str, dict[str, tuple[float, float]]] = {}
    for name in selection.accepted:
        theta = selection.fit.thetas[name]
        c = selection.fit.coefficients[name]
        theta_std, c_std = deviations[name]
        values = terms[name].parameters(theta, c)
        variance = dict.fromkeys(values, 0.0)
        for i, std in enumerate(theta_std):
            for key, slope in _change(terms[name].parameters, theta, c, i, float(std), True):
                variance[key] += slope**2
        for i, std in enumerate(c_std):
            for key, slope in _change(terms[name].parameters, theta, c, i, float(std), False):
                variance[key] += slope**2
        out[name] = {k: (v, float(np.sqrt(variance[k]))) for k, v in values.items()}
    return out | selection.told


def is_magnitude(name: str, parameter: str) -> bool:
    """Whether an error of the model is a share of the parameter: not of a place or a phase."""
    known = effect_of(name).parameter(parameter)
    return known.neutral is not None or known.minimum >= 0.0


def model_of(name: str) -> str:
    """Whose error an effect's parameters share: its link's, or that of all frictions.

    Models of a reversal (pre-sliding) are cruder than the rest of the servo link.
    """
    reverses = any(p.name == 'presliding' for p in effect_of(name).parameters)
    return 'friction' if reverses else link_of(name)


def with_model_error(
    name: str, values: dict[str, tuple[float, float]]
) -> dict[str, tuple[float, float]]:
    """Parameters whose deviations hold what models get wrong: of their kind, and their own."""
    factor, share = SPREAD[model_of(name)]
    out = {}
    for key, (value, std) in values.items():
        doubt = effect_of(name).parameter(key).doubt
        missed = math.hypot(share if is_magnitude(name, key) else 0.0, doubt) * abs(value)
        out[key] = (value, std and math.hypot(factor * std, missed))
    return out


def surer(
    one: dict[str, tuple[float, float]], other: dict[str, tuple[float, float]]
) -> dict[str, tuple[float, float]]:
    """Parameters of an effect that two parts show, each from the part that is surer of it.

    A deviation of zero is that of a parameter that the part does not see.
    """
    out = {**other, **one}
    for name in one.keys() & other.keys():
        seen = [p for p in (one[name], other[name]) if p[1] > 0.0] or [one[name]]
        out[name] = min(seen, key=lambda p: p[1])
    return out


def plain_values(
    parameters: dict[str, dict[str, tuple[float, float]]],
) -> dict[str, dict[str, float]]:
    """Parameters without their standard deviations."""
    return {n: {k: v for k, (v, _) in p.items()} for n, p in parameters.items()}


def _change(
    parameters: object, theta: Theta, c: np.ndarray, i: int, step: float, nonlinear: bool
) -> list[tuple[str, float]]:
    assert callable(parameters)
    ends = []
    for sign in (0.5, -0.5):
        moved_theta, moved_c = list(theta), c.copy()
        if nonlinear:
            moved_theta[i] += sign * step
        else:
            moved_c[i] += sign * step
        ends.append(parameters(tuple(moved_theta), moved_c))
    return [(key, ends[0][key] - ends[1][key]) for key in ends[0]]
