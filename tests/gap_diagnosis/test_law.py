"""The law of the remainder: found, judged where no fit has looked, told, and run by the twin."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gap_diagnosis.law.equation import per
from gap_diagnosis.law.judged import Law, law_of
from gap_diagnosis.law.learn import Remainder, best, firm
from gap_diagnosis.law.search import sound
from gap_diagnosis.law.signals import Signals
from gap_diagnosis.residuals.problem import Problem
from stage_twin.effects.friction import DRY, presliding_state

PERIOD = 5e-3
TIME = np.arange(6000) * PERIOD
PATH = 0.03 * np.sin(1.1 * TIME) * np.sin(0.37 * TIME + 0.5)
SPEED = np.gradient(PATH, PERIOD)


def rows(target: np.ndarray, floor: float) -> tuple[Problem, Signals]:
    """Rows every 5 ms of one axis on a path of two sines; the last third of 5 s is held out."""
    held = np.mod(TIME, 5.0) > 10.0 / 3.0
    seconds = TIME.astype(np.int64)
    number = np.zeros(len(TIME), np.int64)
    signals = Signals(
        {'p': [PATH], 'v': [SPEED], 't': [TIME]},
        lambda *found: np.column_stack([one[0] for one in found]),
        lambda one: one[0],
        [PERIOD],
        lambda reach: [presliding_state(PATH, reach)],
        'm',
        0.01,
    )
    return Problem(target, ~held, held, seconds, TIME, number, {}, floor), signals


def noise(seed: int) -> np.ndarray:
    return 1e-6 * np.random.default_rng(seed).standard_normal(len(TIME))


@pytest.mark.parametrize(
    ('law', 'expression', 'numbers'),
    [
        (9e-6 * np.sign(PATH) * np.abs(PATH / 0.03)**2.4, 'a1*sign(p)*abs(p/p1)^n1', {'n1': 2.4}),
        (5e-6 * np.sin(2 * np.pi * TIME / 0.83 + 0.4), 'a1*sin(2*pi*t/b1 + f1)', {'b1': 0.83}),
        (
            24e-6 * np.sign(SPEED) * np.abs(SPEED / 0.03) ** 2.0 - 4.5e-4 * SPEED,
            'a1*sign(v)*abs(v/v1)^n1 + a2*v',
            {'n1': 2.0, 'a2': -4.5e-4},
        ),
    ],
    ids=['power', 'period', 'power less a line'],
)  # fmt: skip
def test_exponents_and_periods_are_found(law, expression, numbers) -> None:
    found = law_of(*rows(law + noise(1), 1e-6), 'x', 0)
    assert found is not None and found.kind == 'law' and found.expression == expression
    for name, value in numbers.items():
        assert found.parameters[name][0] == pytest.approx(value, rel=0.03)
    assert found.interval[0] < found.shrink < found.interval[1]
    assert found.after < 1.05e-6


def test_noise_has_no_law() -> None:
    assert law_of(*rows(noise(2), 1e-6), 'x', 0) is None


def test_where_no_law_holds_a_curve_does() -> None:
    steps = 6e-6 * np.interp(PATH, np.linspace(-0.03, 0.03, 9), [0, 1, -1, 1, 1, -1, -1, 1, 0])
    found = law_of(*rows(steps + noise(3), 1e-6), 'x', 0)
    assert found is not None
    assert found.shrink > 0.5 and set(found.range) == {'p'}


def test_a_law_stands_in_the_place_of_a_wrong_name() -> None:
    """What a wrong effect took, and added elsewhere, comes back in one plain law."""
    truth = 9e-6 * np.sign(PATH) * np.abs(PATH / 0.03) ** 2.4
    wrong = 4e-6 * np.sin(40.0 * SPEED) * (1.0 + PATH / 0.03)
    problem, signals = rows(truth - wrong + noise(5), 1e-6)
    runs: list[str] = []

    def run(law: Law) -> tuple[float, float]:
        runs.append(law.expression)
        return law.before, law.after

    found = best(Remainder(problem, signals, 'x', {'straightness.y': wrong}), run, 0)
    assert found is not None and found.instead == ('straightness.y',)
    assert found.expression == 'a1*sign(p)*abs(p/p1)^n1' and found.expression in runs
    assert found.before == pytest.approx(np.sqrt(np.mean(problem.target[problem.held_out] ** 2)))
    alone = best(Remainder(*rows(truth + noise(5), 1e-6), 'x', {}), run, 0)
    assert alone is not None and alone.instead == () and alone.expression == found.expression


def test_a_friction_whose_reach_no_row_tells_may_hold_firmly() -> None:
    problem, signals = rows(-5.0 * presliding_state(PATH, 1e-6) + 1e6 * noise(6), 1.0)
    law = law_of(problem, replace(signals, unit='N'), 'x', 0)
    assert law is not None and law.expression == 'a1*s' and firm(law) is None
    untold = replace(law, parameters=law.parameters | {'reach1': (5e-6, 4e-6, 'm')})
    held = firm(untold)
    assert held is not None and held.values == law.values | {'reach0': DRY}
    assert held.parameters['reach1'] == (DRY, 0.0, 'm')


def test_no_law_takes_the_force_balance_back() -> None:
    assert sound(['F:1', 'v:1']) and sound(['a:1', 's:1*v:5'])
    assert not sound(['a:1', 'F:1 without'])


def test_the_search_is_deterministic() -> None:
    problem, signals = rows(5e-6 * np.sin(200.0 * PATH) + noise(4), 1e-6)
    first, second = (law_of(problem, signals, 'x', 0) for _ in range(2))
    assert first is not None and second is not None
    assert first.parameters == second.parameters and first.interval == second.interval


def test_the_rows_that_judge_take_no_part_in_the_fit() -> None:
    problem, signals = rows(5e-6 * np.sin(200.0 * PATH) + noise(4), 1e-6)
    spoilt = replace(problem, target=np.where(problem.held_out, 0.0, problem.target))
    assert law_of(spoilt, signals, 'x', 0) is None


def test_units_of_coefficients() -> None:
    assert per('N', ['m/s']) == 'N·s/m'
    assert per('m', ['m', 'K']) == '1/K'
    assert per('N', ['m/s^2']) == 'N·s²/m'
    assert per('N', []) == 'N'
