"""A controller that is not the twin's is a finding, read from the recorded commands."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.experiment.machine import START, as_session
from gap_diagnosis.__main__ import main
from gap_diagnosis.diagnose import diagnose
from gap_diagnosis.input.data import load_record
from gap_diagnosis.input.noise import AxisNoise, Noise
from gap_diagnosis.parameters import Parameters
from gap_diagnosis.report.document import as_dict
from gap_diagnosis.residuals.commands import controller_findings
from gap_diagnosis.residuals.effort_signs import likeliest
from gap_diagnosis.residuals.recording import in_another_unit, in_newtons
from gap_diagnosis.result import Diagnosis
from session_bags.writer import write_session
from stage_core import topics
from stage_core.session import Series, Session
from stage_core.twin_file import ServoAxis, TrackerSpec, TwinFile
from stage_twin.simulate import simulate

from .conftest import nominal, reference

Maker = Callable[..., Session]


def other_gains(change: dict[str, float]) -> TwinFile:
    """The nominal twin of axis x with other gains than the machine of `planted` has."""
    twin = TwinFile.nominal_servo()
    axis = twin.axes['x']
    assert isinstance(axis, ServoAxis)
    return replace(twin, axes={'x': replace(axis, **change)}, tracker=TrackerSpec())


def found(session: Session, change: dict[str, float]) -> Diagnosis:
    return diagnose([session], [], other_gains(change))


@pytest.mark.parametrize(
    'change',
    [
        {'velocity_gain': 2400.0, 'integral_gain': 60000.0},
        {'position_gain': 25.0},
        {'velocity_filter': 300.0},
    ],
)
def test_other_gains_are_named_with_their_values(planted: Maker, change: dict[str, float]) -> None:
    result = found(planted({}, duration=10.0), change)
    assert result.verdict == ['controller_mismatch.x']
    values = result.parameters['controller_mismatch.x']
    assert set(values) == {f'{name}_error' for name in change}
    true = TwinFile.nominal_servo().servo('x')
    for name, own in change.items():
        value, _ = values[f'{name}_error']
        assert value == pytest.approx(getattr(true, name) / own - 1.0, rel=0.01)
    assert result.after < 0.2 * result.before
    # The report holds nine digits of a gain that the record tells to more.
    (cause,) = (c for c in as_dict(result)['causes'] if c['effect'] == 'controller_mismatch.x')
    for stated in cause['parameters'].values():
        assert stated['std'] == 0.0 or stated['std'] > 4e-9 * abs(stated['value'])


def test_what_shakes_another_session_hides_no_other_filter(planted: Maker) -> None:
    """Forces of another source on a held-out session: EMPS with force pulses."""
    session = planted({}, duration=10.0)
    old = session.series[topics.COMMAND]
    shaken = old.values['effort.x'] + np.random.default_rng(2).normal(0.0, 0.5, len(old))
    series = {
        **session.series,
        topics.COMMAND: Series(topics.COMMAND, old.stamps, {**old.values, 'effort.x': shaken}),
    }
    twin = other_gains({'velocity_filter': 300.0})
    records = [load_record(session, twin)]
    records.append(load_record(replace(session, series=series), twin, held_out=True))
    found, _ = controller_findings(records, twin)
    values = found['controller_mismatch.x']
    true = TwinFile.nominal_servo().servo('x').velocity_filter
    assert values['velocity_filter_error'][0] == pytest.approx(true / 300.0 - 1.0, rel=0.01)


def test_the_error_of_a_feedforward_is_absolute(planted: Maker) -> None:
    result = found(planted({}, duration=10.0), {'velocity_feedforward': 0.8})
    true = TwinFile.nominal_servo().servo('x').velocity_feedforward
    value, _ = result.parameters['controller_mismatch.x']['velocity_feedforward_error']
    assert value == pytest.approx(true - 0.8, abs=0.01)
    assert result.after < 0.2 * result.before


def test_an_effect_is_found_beside_other_gains(planted: Maker) -> None:
    session = planted({'coulomb_friction.x': {'coulomb': 15.0}})
    result = found(session, {'velocity_gain': 2400.0, 'integral_gain': 60000.0})
    assert set(result.verdict) == {'controller_mismatch.x', 'coulomb_friction.x'}


def test_a_limit_of_the_controller_is_a_gap(planted: Maker) -> None:
    session = planted({'force_saturation.x': {'limit': 12.0, 'known': 1.0}})
    result = diagnose([session], [], other_gains({}))
    assert result.verdict == ['force_saturation.x']
    assert result.parameters['force_saturation.x']['limit'][0] == pytest.approx(12.0)
    assert result.after < 0.2 * result.before


def declared(session: Session) -> Session:
    """The session with a set-point of a position and the commanded velocity in each tick."""
    reference, command = session.series[topics.REFERENCE], session.series[topics.COMMAND]
    values = {
        'position.x': reference.values['position.x'],
        'velocity.x': command.values['velocity.x'],
    }
    setpoint = Series(topics.SETPOINT, reference.stamps, values)
    return replace(session, series={**session.series, topics.SETPOINT: setpoint})


def test_the_terms_of_a_contour_controller_are_inputs(tmp_path: Path) -> None:
    twin = nominal()
    path = reference(10.0, twin.control_period, 1)
    rate = np.gradient(path, twin.control_period, axis=0)
    terms = 5e-4 * np.sin(2.0 * np.pi * 3.0 * np.arange(len(path)) * twin.control_period)
    made = simulate(twin, path, rate, compensation=terms[:, None], seed=1)
    run_once = as_session(made, twin, path, START, 'contour')
    twin.save(tmp_path / 'twin.yaml')
    verdicts = []
    for name, session in (('silent', run_once), ('declared', declared(run_once))):
        bag = write_session(tmp_path / name, session)
        words = ['--bag', str(bag), '--twin', str(tmp_path / 'twin.yaml'), '--no-page', '--quiet']
        assert main([*words, '--out', str(tmp_path / f'{name}_out')]) == 0
        report = json.loads((tmp_path / f'{name}_out' / 'report.json').read_text())
        verdicts.append(report['verdict'])
        # The wave that the terms make, and nothing.
        before = report['gap']['channels']['encoder.x']['before']
        assert (before > 5e-6) is (name == 'silent')
    assert verdicts[0] != [] and verdicts[1] == []


def test_other_gains_are_a_finding_whoever_sends_them(planted: Maker) -> None:
    plain = planted({}, duration=10.0)
    for session in (plain, declared(plain)):
        assert found(session, {'position_gain': 25.0}).verdict == ['controller_mismatch.x']


@pytest.mark.parametrize(
    ('factor', 'magnitude'), [(-1.0, 0.0), (0.01 / 6.2832, 0.0), (1.0, 1.0), (0.01, 1.0)]
)
def test_an_effort_that_is_no_force_in_newtons_is_said_and_mended(
    planted: Maker, factor: float, magnitude: float
) -> None:
    convention = {'factor': factor, 'magnitude': magnitude}
    effects = {'effort_convention.x': convention, 'coulomb_friction.x': {'coulomb': 15.0}}
    result = found(planted(effects), {})
    assert set(result.verdict) == set(effects)
    values = result.parameters['effort_convention.x']
    assert values['factor'][0] == pytest.approx(factor, rel=1e-3)
    assert values['magnitude'][0] == magnitude
    assert result.parameters['coulomb_friction.x']['coulomb'][0] == pytest.approx(15.0, rel=0.05)


def test_an_effort_without_sign_is_told_although_noise_takes_it_below_zero(
    planted: Maker,
) -> None:
    convention = {'effort_convention.x': {'factor': 1.0, 'magnitude': 1.0}}
    made = planted(convention, duration=10.0)
    old = made.series[topics.COMMAND]
    noise = np.random.default_rng(4).normal(0.0, 0.02, len(old))
    effort = old.values['effort.x'] + noise
    assert effort.min() < 0.0
    noisy = Series(topics.COMMAND, old.stamps, {**old.values, 'effort.x': effort})
    result = found(replace(made, series={**made.series, topics.COMMAND: noisy}), {})
    assert result.verdict == ['effort_convention.x']


@pytest.mark.parametrize('size', [0.7, 0.1, 0.01])
def test_noise_of_an_effort_hides_no_unit(planted: Maker, size: float) -> None:
    """The largest [N] is most of the increments of the effort."""
    twin = other_gains({})
    record = load_record(planted({}, duration=10.0), twin)
    step = twin.servo('x').encoder_resolution
    noise = np.random.default_rng(4).normal(0.0, size, record.force.shape)
    known = Noise((AxisNoise(step / math.sqrt(12.0), 0.0, 0.1 * size, step),), None)
    made = replace(record, force=0.1 * (record.force + noise), noise=known)
    (told,) = in_newtons([made], twin, ())[1].values()
    assert told['factor'][0] == pytest.approx(0.1, abs=3.0 * told['factor'][1])
    assert told['factor'][1] < 0.001


def test_an_effort_of_the_wrong_sign_that_is_all_noise_has_lost_none(planted: Maker) -> None:
    twin = other_gains({})
    record = load_record(planted({}, duration=10.0), twin)
    noise = Noise((AxisNoise(0.0, 0.0, float(np.abs(record.force).max()), 0.0),), None)
    turned = replace(record, force=-record.force, noise=noise)
    _, values = in_newtons([turned], twin, ())
    assert values['effort_convention.x']['factor'][0] == pytest.approx(-1.0)
    assert values['effort_convention.x']['magnitude'][0] == 0.0


def test_the_signs_of_magnitudes_are_those_whose_increments_follow_the_law() -> None:
    force = 3.0 * np.sin(np.arange(1.0, 60.0))
    np.testing.assert_array_equal(likeliest(np.abs(force), np.diff(force)), np.sign(force))


def test_an_effort_that_the_twin_says_of_itself_is_no_finding(planted: Maker) -> None:
    convention = {'effort_convention.x': {'factor': 0.01, 'magnitude': 0.0}}
    session = planted(convention, duration=10.0)
    assert diagnose([session], [], other_gains({}).with_effects(convention)).verdict == []


def test_gains_and_a_drive_that_make_up_for_one_another_are_another_unit(
    planted: Maker,
) -> None:
    # A spring hides the mass at first, so that the unit is told by what is found in its place.
    truth = {
        'effort_convention.x': {'factor': 2.0, 'magnitude': 0.0},
        'cable_force.x': {'stiffness': 2000.0},
    }
    result = diagnose([planted(truth)], [], other_gains({}))
    assert sorted(result.verdict) == sorted(truth)
    assert result.parameters['effort_convention.x']['factor'][0] == pytest.approx(2.0, rel=1e-3)
    gains = {'velocity_gain_error': (1.0, 0.0), 'integral_gain_error': (1.0, 0.0)}
    pair = {'controller_mismatch.x': gains, 'drive_gain.x': {'error': (-0.5, 1e-3)}}
    assert in_another_unit(pair, ()) == 'controller_mismatch.x'
    assert in_another_unit(pair, ('effort_convention',)) is None
    assert in_another_unit({**pair, 'drive_gain.x': {'error': (-0.4, 1e-3)}}, ()) is None


def test_gains_that_are_wrong_by_one_large_factor_are_another_unit() -> None:
    def gains(velocity: float, integral: float) -> Parameters:
        values = {'velocity_gain_error': (velocity, 0.01), 'integral_gain_error': (integral, 0.01)}
        return {'controller_mismatch.x': values}

    assert in_another_unit(gains(-0.9, -0.901), ()) == 'controller_mismatch.x'
    assert in_another_unit(gains(-0.5, -0.5), ()) is None  # as controllers are
    assert in_another_unit(gains(-0.9, -0.92), ()) is None
    # A drive that does not make up for it speaks against a unit.
    drive = {'drive_gain.x': {'error': (0.6, 0.01)}}
    assert in_another_unit({**gains(1.0, 1.0), **drive}, ()) is None
    assert in_another_unit({**gains(-0.9, -0.901), **drive}, ()) is None


def test_with_the_gains_of_the_twin_another_unit_shows_through_the_noise_of_the_effort(
    planted: Maker,
) -> None:
    twin, own_gains = other_gains({}), ('controller_mismatch.x',)
    record = load_record(planted({}, duration=10.0), twin)
    size = 0.002 * float(np.abs(record.force).max())
    noise = np.random.default_rng(1).normal(0.0, size, record.force.shape)
    told = Noise((AxisNoise(0.0, 0.0, size, 0.0),), None)
    noisy = replace(record, force=0.1 * (record.force + 10.0 * noise), noise=told)
    assert in_newtons([noisy], twin, ())[1] == {}
    _, values = in_newtons([noisy], twin, own_gains)
    assert values['effort_convention.x']['factor'][0] == pytest.approx(0.1, rel=0.1)
    # Nothing but noise has no unit, whatever is known of it.
    for known in (told, Noise((AxisNoise(0.0, 0.0, 10.0 * size, 0.0),), None)):
        alone = replace(noisy, force=10.0 * noise, noise=known)
        assert in_newtons([alone], twin, own_gains)[1] == {}


def test_a_filter_and_a_mass_that_are_wrong_alike_are_no_other_unit(planted: Maker) -> None:
    # Both make 0.93 of the forces; the record follows the law of the other filter to its digits.
    truth = {
        'controller_mismatch.x': {'velocity_filter_error': -0.1},
        'inertia_mismatch.x': {'ratio': -0.07},
    }
    verdict = diagnose([planted(truth)], [], other_gains({})).verdict
    assert sorted(verdict) == sorted(truth)
