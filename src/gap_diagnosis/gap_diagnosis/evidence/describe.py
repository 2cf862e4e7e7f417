"""The parameters of accepted effects with their standard deviations."""

from __future__ import annotations

import math

import numpy as np

from gap_diagnosis.evidence.calibrated import SPREAD
from gap_diagnosis.parameters import Parameters
from gap_diagnosis.residuals.regression import Regression
from gap_diagnosis.residuals.uncertainty import uncertainty
from gap_diagnosis.selection.model import Selection
from stage_core.arrays import Array
from stage_twin.effects import effect_of, link_of
from stage_twin.effects.term import Term, Theta


def describe(selection: Selection, regression: Regression, given: str | None = None) -> Parameters:
    """Parameters of each accepted effect as (value, standard deviation).

    The deviations of parameters that are functions of coefficients follow by propagation with
    central differences. Those of the effect `given` hold for the shape (θ) that was found.
    """
    terms = regression.problem.terms
    deviations = uncertainty(regression, selection.fit, given)
    out: Parameters = {}
    for name in selection.accepted:
        theta = selection.fit.thetas[name]
        c = selection.fit.coefficients[name]
        theta_std, c_std = deviations[name]
        values = terms[name].parameters(theta, c)
        variance = dict.fromkeys(values, 0.0)
        changes = [_by_theta(terms[name], theta, c, i, float(s)) for i, s in enumerate(theta_std)]
        changes += [_by_factor(terms[name], theta, c, i, float(s)) for i, s in enumerate(c_std)]
        for change in changes:
            for key, slope in change.items():
                variance[key] += slope**2
        out[name] = {k: (v, float(np.sqrt(variance[k]))) for k, v in values.items()}
    return out


def given_shape(
    name: str,
    values: dict[str, tuple[float, float]],
    selection: Selection,
    regression: Regression,
) -> dict[str, tuple[float, float]]:
    """Parameters of an effect with the deviations by which it is told whether it is there.

    One that is told by its shape has those at the shape that was found. Of any other, parameters
    without a deviation have: where all lines lie at one place across, neither the arm of a yaw nor
    the yaw is known, while their product is seen well. An arm that is known badly makes no yaw:
    two wrong ones were 0.75 of their deviations large, right ones 8 and more.
    """
    if regression.problem.terms[name].fixed:  # of which the shape is all
        return values
    held = describe(selection, regression, name)[name]
    out = dict(values)
    for key in held.keys() & values.keys():
        value, std = values[key]
        if std == 0.0 or (effect_of(name).by_shape and held[key][1] > 0.0):
            out[key] = value, min(std or np.inf, held[key][1])
    return out


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
    shown = {key for key, (_, std) in values.items() if std > 0.0}
    out = {}
    for key, (value, std) in values.items():
        doubt = effect_of(name).parameter(key).doubted(shown)
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


def not_seen(name: str, values: dict[str, tuple[float, float]]) -> list[str]:
    """Parameters that no part of the session shows: neutral, and without a deviation.

    What an effect of the sensor link says is read from the record itself, and exact.
    """
    if link_of(name) == 'sensor':
        return []
    return [
        p.name
        for p in effect_of(name).parameters
        if p.fitted and not p.nuisance and values.get(p.name) == (p.neutral, 0.0)
    ]


def _by_theta(term: Term, theta: Theta, c: Array, i: int, std: float) -> dict[str, float]:
    """Change of each parameter with a deviation of one θ, seen between the bounds that it has."""
    ends = []
    for sign in (0.5, -0.5):
        moved = list(theta)
        moved[i] = min(max(theta[i] + sign * std, term.lower[i]), term.upper[i])
        ends.append((moved[i], term.parameters(tuple(moved), c)))
    (high, above), (low, below) = ends
    scale = std / (high - low) if high > low else 0.0
    return {key: scale * (above[key] - below[key]) for key in above}


def _by_factor(term: Term, theta: Theta, c: Array, i: int, std: float) -> dict[str, float]:
    """Change of each parameter with a deviation of one coefficient."""
    step = 0.5 * std * np.eye(len(c))[i]
    above, below = term.parameters(theta, c + step), term.parameters(theta, c - step)
    return {key: above[key] - below[key] for key in above}
