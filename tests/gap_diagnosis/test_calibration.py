"""The fit of the probabilities and the page of their calibration."""

from __future__ import annotations

import math
import runpy
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.blind.cases import Case
from benchmarks.blind.suites import case
from benchmarks.calibrate.__main__ import BLIND, BLOCK
from benchmarks.calibrate.collect import FITTED, _below
from benchmarks.calibrate.figures import coverage, unseen, verdicts, without_doubtful
from benchmarks.calibrate.fit import CANDIDATES, choose, left_out, stated, statements, weights_of
from benchmarks.calibrate.page import headline, markdown, write_weights
from benchmarks.calibrate.sessions import own_truth, samples
from benchmarks.calibrate.spread import spread_of, widened
from benchmarks.calibrate.truth import in_report_terms
from gap_diagnosis.evidence import probability as evidence
from gap_diagnosis.evidence.describe import with_model_error
from gap_diagnosis.evidence.judgement import Cause
from gap_diagnosis.evidence.probability import Scene, with_probabilities
from stage_core.twin_file import TwinFile

GENERATORS = ('own', 'mujoco', 'handmade')


def sessions(count: int = 400) -> list[dict[str, Any]]:
    """Rows in which `strength` alone tells true names; most candidates are passed over rightly."""
    g = np.random.default_rng(4)
    rows = []
    for number in range(count):
        strength, chance = g.uniform(-1.0, 4.0), g.uniform(-3.0, 3.0)
        true = bool(g.random() < 1.0 / (1.0 + np.exp(-(2.0 * strength - 1.0))))
        named = {
            'effect': 'backlash.x', 'kind': 'named', 'true': true,
            'features': {'strength': strength, 'turns': chance},
            'parameters': {'width': [1e-5, 1e-6]},
        }  # fmt: skip
        passed = {'kind': 'passed', 'true': False, 'features': {}, 'parameters': {}}
        rows.append({
            'generator': GENERATORS[number % 3], 'name': f'{number}', 'exact': true,
            'kind': 'single', 'truth': ['backlash.x'] if true else ['scale_error.x'],
            'also_right': [], 'verdict': ['backlash.x'], 'false': [] if true else ['backlash.x'],
            'intervals': [('backlash.x', 'width', g.standard_normal(), 0.4)],
            'statements': [named, *({'effect': f'e{k}', **passed} for k in range(9))],
            'structure': [['servo.x', 0.0 if true else 0.05, 9.0]],
        })  # fmt: skip
    return rows


def test_the_fit_finds_what_tells_and_leaves_out_what_does_not() -> None:
    found = statements(sessions(), 'named')
    assert choose(found, ('turns', 'strength', 'gap')) == ['strength']
    weights = weights_of(found, ['strength'])
    assert weights['strength'] == pytest.approx(2.0, abs=0.6)
    p = left_out(found, ['strength'])
    true = np.array([s['true'] for s in found])
    assert np.mean(true[p > 0.9]) == pytest.approx(np.mean(p[p > 0.9]), abs=0.05)


def test_names_that_others_doubt_are_left_out() -> None:
    rows = sessions()
    before = verdicts(rows)
    after = verdicts(without_doubtful(rows, {'named': {'1': 0.0, 'strength': 0.0}}))
    assert after['false'] < 0.6 * before['false']
    assert after['exact'] > 0.9 * before['exact']


def test_what_was_never_seen_false_is_not_certain() -> None:
    certain = [{'true': True, 'generator': 'own', 'features': {}}] * 9
    assert stated(weights_of(certain, []), certain)[0] == pytest.approx(0.95)
    assert stated(weights_of([], []), certain)[0] == pytest.approx(0.5)


def test_no_statement_is_surer_than_its_kind_was_on_machines_first_seen(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(evidence, 'WEIGHTS', {k: {'1': 6.0} for k in ('named', 'unknown', 'none')})
    alone, doubted = (evidence.probability('named', {}, beside) for beside in (False, True))
    assert alone == evidence.FIRST_SEEN['named'] < 0.99
    assert doubted == evidence.FIRST_SEEN[evidence.BESIDE_UNKNOWN] < alone
    assert evidence.probability('unknown', {}, True) == evidence.FIRST_SEEN['unknown'] < 0.6
    assert evidence.probability('none', {}) > 0.99
    near, far = (evidence.probability('none', {'gap': math.log(gap)}) for gap in (1.9, 2.1))
    assert near > 0.99
    assert far == evidence.FIRST_SEEN[evidence.FAR_NONE] <= 0.5


def test_one_statement_leaves_its_rest_to_the_others() -> None:
    scene = Scene(5.0, 1.0, 0.0, False, {'x': 9})
    named = Cause('backlash.x', 0.0, {'width': (1e-5, 1e-7)}, 5.0, 1.0, (0.7, 0.9), 'accepted')
    named.strength = 40.0
    others = [
        Cause(name, 0.0, {}, 1.0, 1.0, (0.0, 0.0), 'rejected')
        for name in ('scale_error.x', 'unknown', 'none')
    ]
    found = with_probabilities([named], others, scene)
    assert found[0] is named and 0.5 < named.probability < 1.0
    assert sum(c.probability for c in found) == pytest.approx(1.0)


@pytest.mark.parametrize('status', ['accepted', 'rejected'])
def test_a_name_beside_an_unknown_is_less_probable(
    monkeypatch: pytest.MonkeyPatch, status: str
) -> None:
    monkeypatch.setattr(evidence, 'WEIGHTS', {k: {'1': 6.0} for k in evidence.WEIGHTS})
    name, unknown = (
        Cause(n, 0.0, {}, 5.0, 1.0, (0.7, 0.9), s)
        for n, s in (('scale_error.x', 'accepted'), ('unknown', status))
    )
    with_probabilities([name], [unknown], Scene(5.0, 1.0, 0.0, False, {'x': 9}))
    kind = evidence.BESIDE_UNKNOWN if status == 'accepted' else 'named'
    assert name.probability == evidence.FIRST_SEEN[kind]


def test_a_name_that_is_not_told_from_another_leaves_it_the_rest(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(evidence, 'WEIGHTS', {k: {'1': 6.0} for k in evidence.WEIGHTS})
    evidence.WEIGHTS['passed']['1'] = -6.0
    named, sure = (
        Cause(n, 0.0, {}, 5.0, 1.0, (0.7, 0.9), 'accepted')
        for n in ('actuation_delay.x', 'backlash.y')
    )
    named.alternatives = ['current_loop_lag.x']
    others = [
        Cause(n, 0.0, {}, 1.0, 1.0, (0.0, 0.0), 'rejected')
        for n in ('current_loop_lag.x', 'drive_gain.x')
    ]
    with_probabilities([named, sure], others, Scene(5.0, 1.0, 0.0, False, {'x': 9}))
    assert named.probability == evidence.FIRST_SEEN[evidence.NOT_TOLD]
    assert sure.probability == evidence.FIRST_SEEN['named'] > named.probability
    alternative, passed = others
    assert alternative.probability == pytest.approx(1.0 - named.probability)
    assert passed.probability < 0.01


def test_truths_are_put_in_the_terms_of_a_report() -> None:
    twin = TwinFile.nominal_servo()
    mass = twin.servo('x').mass
    planted = [
        {'name': 'inertia_mismatch.x', 'parameters': {'mass': 0.2 * mass}},
        {'name': 'base_resonance.x', 'parameters': {'frequency': 10.0, 'damping': 0.1,
                                                    'mass': 3.0 * mass}},
    ]  # fmt: skip
    inertia, base = in_report_terms({'planted': planted}, twin)['planted']
    assert inertia['parameters']['ratio'] == pytest.approx(0.2)
    assert base['parameters']['mass_ratio'] == pytest.approx(0.25)
    assert base['parameters']['frequency'] == pytest.approx(10.0 * 0.75**0.5)
    one = next(c for n in range(80, 99) if (c := case('main', n, 'development')).kind == 'small')
    assert own_truth(one)['truth'] == [] and own_truth(one)['also_right'] == [[*one.truth]]


def test_verdicts_that_no_record_tells_from_the_truth_are_right_too() -> None:
    noise = {'rate': 100.0, 'noise': 1e-6, 'duration': 30.0, 'axes': ('x', 'y')}

    def also(*planted: str) -> list[list[str]]:
        truth = dict.fromkeys(planted, {'size': 1.0})
        return own_truth(Case(0, 0, 'mixed', truth=truth, planted=planted, **noise))['also_right']

    assert also('backlash.x', 'hidden_grating.y') == [['backlash.x', 'cyclic_pitch_error.y']]
    assert also('cyclic_pitch_error.y', 'hidden_grating.y') == []
    assert also('hidden_bump.x') == [['position_force.x'], ['position_force.x', 'unknown']]
    assert also('hidden_shake.x') == []
    assert also('coulomb_friction.x', 'force_offset.x') == [['asymmetric_friction.x']]


def test_seeds_of_reports_stay_closed() -> None:
    with pytest.raises(ValueError, match='seed 100'):
        samples('handmade', 100)


def test_the_page_and_the_weights(tmp_path: Path) -> None:
    rows = sessions()
    weights = {kind: weights_of(statements(rows, kind), []) for kind in CANDIDATES}
    facts = {'code': 'abc', 'date': '2026-01-01', 'seeds': '1 to 9', 'sessions': {'own': 134}}
    spread = spread_of(rows)
    write_weights(tmp_path / FITTED, weights, spread, facts)
    written = runpy.run_path(str(tmp_path / FITTED))
    assert written['WEIGHTS']['named']['1'] == pytest.approx(weights['named']['1'], rel=1e-5)
    assert written['SESSIONS'] == {'own': 134}
    text = markdown(rows, weights, spread, facts)
    assert '134 of `own`' in text and '| backlash.width | 400 |' in text
    right = sum(row['exact'] for row in rows)
    assert f'| servo | 0.04 | {right} | 0 | {len(rows) - right} | 0 |' in text
    held = coverage(rows)['backlash.width']
    assert 0.9 < held['holds'] < 0.99 and held['open'] == 0.0
    assert {g: len(p) for g, p in unseen(rows, weights).items()}['own'] == 134 * 10


def test_the_headline_has_a_row_for_each_generator_left_out() -> None:
    rows = sessions()
    weights = {
        kind: weights_of(statements(rows, kind), ['strength'] if kind == 'named' else [])
        for kind in CANDIDATES
    }
    facts = {'code': 'abc', 'date': '2026-01-01', 'seeds': '1 to 9', 'sessions': {'own': 134}}
    text = headline(rows, weights, facts)
    own = [row for row in rows if row['generator'] == 'own']
    exact = sum(row['exact'] for row in own) / 134
    assert f'| own | 134 | {exact:.2f} | {100.0 - 100.0 * exact:.1f} |' in text
    cells = [line.strip('| ').split(' | ') for line in text.splitlines()[-3:]]
    for _, _, _, _, count, said, true, holds in cells:
        assert 20 < int(count) < 134 and abs(float(said) - float(true)) < 0.05
        assert 0.9 < float(holds) < 0.99
    assert len(BLOCK.findall(BLIND.read_text('utf-8'))) == 1


def test_deviations_are_widened_until_their_intervals_hold() -> None:
    g = np.random.default_rng(7)
    # Deviations of 1 % that leave out an error of the model of 3 % of the value.
    errors = np.hypot(0.01, 0.03) * g.standard_normal(300)
    rows = [
        {
            'exact': True,
            'statements': [],
            'intervals': [('backlash.x', 'width', e / 0.01, 3.92 * 0.01)],
        }
        for e in errors
    ]
    spread = spread_of(rows)
    assert spread['servo'] == (1.0, 0.0)
    assert coverage(rows)['all']['holds'] < 0.6
    held = coverage(widened(rows, spread))['all']
    assert held['holds'] == pytest.approx(0.953, abs=0.01)
    assert held['width'] == pytest.approx(3.92 * np.hypot(0.01, 0.03), rel=0.15)


def test_a_session_whose_parameters_are_all_wrong_counts_once() -> None:
    def session(sigmas: float, parameters: int = 1) -> dict[str, Any]:
        return {'exact': True, 'intervals': [('backlash.x', 'width', sigmas, 0.04)] * parameters}

    right = [session(1.0)] * 39
    assert spread_of([*right, session(50.0, 3)])['kinematic'] == (1.0, 0.0)
    assert spread_of([*right, *[session(4.0)] * 3])['kinematic'] != (1.0, 0.0)


def test_the_code_of_a_session_does_not_hold_what_is_fitted() -> None:
    names = [path.name for path in _below('src/gap_diagnosis/gap_diagnosis')]
    assert 'probability.py' in names and FITTED not in names


def test_a_frequency_that_the_tracker_alone_shows_is_doubted() -> None:
    """The share of the mass that swings raises it, and is not shown: its deviation is zero."""
    shown = {'frequency': (40.0, 0.1), 'mass_ratio': (0.3, 0.02)}
    alone = {**shown, 'mass_ratio': (0.0, 0.0)}
    both, tracker = (with_model_error('structural_resonance.x', v) for v in (shown, alone))
    assert both['frequency'][1] < 1.0 and tracker['frequency'][1] > 0.1 * 40.0
    row = {
        'generator': 'own',
        'exact': True,
        'intervals': [('structural_resonance.x', 'frequency', 9.0, 0.05)],
    }
    told = {
        **row,
        'intervals': [*row['intervals'], ('structural_resonance.x', 'mass_ratio', 0.0, 0.1)],
    }
    wide, narrow = (widened([r], {'servo': (1.0, 0.0)})[0]['intervals'][0] for r in (row, told))
    assert wide[3] > 5.0 * narrow[3]
