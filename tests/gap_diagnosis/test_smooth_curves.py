"""A curve of the travel of which each place was visited once."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.polynomial.legendre import legval
from numpy.typing import NDArray

from gap_diagnosis.evidence.describe import describe
from gap_diagnosis.residuals.problem import Problem
from gap_diagnosis.residuals.regression import Regression
from gap_diagnosis.selection.model import Evidence, Selection
from stage_twin.effects.shared import ORDERS, roughness
from stage_twin.effects.term import Term, constant

Array = NDArray[np.float64]

NOISE = 0.02  # of a curve of about 1
NAMES = [f'p{k}' for k in range(2, ORDERS + 1)]
TIME = np.arange(0.0, 24.0, 0.01)


def _once_along_the_travel(seed: int) -> tuple[Problem, Array]:
    """Rows of a smooth curve on a path along its travel in twelve steps."""
    rng = np.random.default_rng(seed)
    place = (2.0 * (TIME // 2.0) - 11.0) / 12.0 + 0.04 * np.sin(2.0 * np.pi * TIME)
    truth = 1e-3 * rng.normal(size=ORDERS - 1) / np.sqrt(roughness(2, ORDERS))
    columns = np.stack([legval(place, one) for one in np.eye(ORDERS + 1)[2:]], axis=1)
    rows = columns @ truth + NOISE * rng.normal(size=len(TIME))
    term = Term(
        constant(columns),
        lambda theta, c: dict(zip(NAMES, c.tolist(), strict=True)),
        roughness=roughness(2, ORDERS),
    )
    held = (TIME // 1.0) % 10 == 9
    number = np.zeros(len(TIME), dtype=np.int64)
    block = (5.0 * TIME).astype(np.int64)
    return Problem(rows, ~held, held, block, TIME, number, {'bend': term}, NOISE), truth


def test_it_predicts_places_that_no_row_of_a_fit_was_at() -> None:
    problem, _ = _once_along_the_travel(1)
    smooth = Regression(problem).linear({'bend': ()})
    any_shape = replace(problem.terms['bend'], roughness=None)
    rough = Regression(replace(problem, terms={'bend': any_shape})).linear({'bend': ()})
    assert smooth.mean_square(problem) < 2.0 * NOISE**2
    assert rough.mean_square(problem) > 10.0 * smooth.mean_square(problem)


def test_its_factors_are_within_their_deviations() -> None:
    within: list[bool] = []
    for seed in range(20):
        problem, truth = _once_along_the_travel(seed)
        regression = Regression(problem)
        fit = regression.linear({'bend': ()})
        evidence = {'bend': Evidence('bend', 1.0, (1.0, 1.0), 1.0, True)}
        found = describe(Selection(['bend'], fit, evidence, {}), regression)['bend']
        within += [
            bool(abs(found[n][0] - t) < 2.0 * found[n][1])
            for n, t in zip(NAMES, truth, strict=True)
        ]
    assert np.mean(within) > 0.9
