"""Effects of the drive and of the machine around it are named with their parameters."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.experiment.machine import session as run_of
from gap_diagnosis.diagnose import diagnose
from gap_diagnosis.input.data import load_record
from gap_diagnosis.residuals.servo import Servo
from stage_core.arrays import Array
from stage_core.session import Session
from stage_core.twin_file import TwinFile
from stage_twin.effects import EFFECTS, position_dependent_friction, torque_sag

from .conftest import nominal

Maker = Callable[..., Session]

#: A level of friction at seven knots over a travel of 60 mm.
LEVELS = {f'c{k}': level for k, level in enumerate((6.0, 7.0, 10.0, 15.0, 17.0, 14.0, 10.0))}


@pytest.mark.parametrize(
    ('effect', 'planted_values', 'tolerance'),
    [
        ('axis_crosstalk.x', {'mass': 1.5, 'viscous': 20.0}, 0.1),
        ('axis_crosstalk.x', {'mass': -8.0, 'viscous': -1000.0}, 0.1),
        # A spring without any stiffness in the middle.
        ('cable_force.x', {'stiffness': 0.0, 'hardening': 2e6}, 0.1),
        ('current_loop_lag.x', {'time_constant': 2e-3}, 0.1),
        ('torque_sag.x', {'sag_force': 2e-3}, 0.1),
        ('torque_sag.x', {'sag_force': 0.0, 'sag_speed': 1.0}, 0.1),
        ('torque_sag.x', {'sag_force': 0.0, 'sag_heat': 2e-3, 'heat_time': 4.0}, 0.15),
        ('torque_sag.x', {'sag_force': 0.0, 'sag_time': 0.2, 'heat_time': 4.0}, 0.15),
        # Two ways at once: iron that saturates, and what runs beside it warms.
        (
            'torque_sag.x',
            {'sag_force': 6e-3, 'sag_time': 0.2, 'heat_time': 4.0},
            0.2,
        ),
        # Nearly every tick asks for more than that.
        ('force_saturation.x', {'limit': 5.0}, 0.02),
    ],
)
def test_a_planted_effect_is_named(
    planted: Maker, effect: str, planted_values: dict[str, float], tolerance: float
) -> None:
    axes = ('x', 'y') if effect.startswith('axis_crosstalk') else ('x',)
    session = planted({effect: planted_values}, axes=axes, duration=12.0)
    found = diagnose([session], [], nominal(axes))
    assert found.verdict == [effect]
    for name, value in planted_values.items():
        estimate, deviation = found.parameters[effect][name]
        near = pytest.approx(value, rel=tolerance, abs=2.0 * deviation)
        assert estimate == near, EFFECTS[effect.partition('.')[0]].parameter(name).meaning


def test_a_limit_leaves_force_enough_to_move_the_mass() -> None:
    """On a sine 5 N of any force go with the acceleration; they do not make that of a free one."""
    time, limit = np.arange(6000) * 1e-3, 5.0
    path, twin = 0.01 * np.sin(6.0 * np.pi * time)[:, None], nominal()
    limited = twin.with_effects({'force_saturation.x': {'limit': limit}})
    for machine in (twin, limited):
        record = load_record(run_of(machine, twin, path, 20.0 + 0.0 * time, 0), twin)
        rows = Servo([record], twin, 'x')
        share = limit / float(np.abs(rows.commanded()[0]).max())
        term = rows.problem().terms['force_saturation.x']
        assert term.admissible((share,), np.ones(1)) is (machine is limited)


def test_no_error_of_an_integrator_follows_another_axis(planted: Maker) -> None:
    session, twin = planted({}, axes=('x', 'y'), duration=8.0), TwinFile.nominal_servo()
    record = load_record(session, twin)
    alone = Servo([record], twin, 'x').problem().terms['axis_crosstalk.x'].follows
    one = replace(record, encoder=record.encoder[:, [0, 0]], force=record.force[:, [0, 0]])
    together = Servo([one], twin, 'x').problem().terms['axis_crosstalk.x'].follows
    assert alone < 0.7
    assert together > 0.9


def test_a_torque_sags_down_to_a_fifth_and_no_further(planted: Maker) -> None:
    record, twin = load_record(planted({}, duration=8.0), nominal()), nominal()
    rows = Servo([record], twin, 'x')
    term = rows.problem().terms['torque_sag.x']
    deep, plain = (1.0, 1.0, 0.25), (1.0, 1.0, 1.0)
    force = np.abs(rows.applied()[0])
    assert np.abs(term.columns(deep)).max() < 0.3 * np.abs(term.columns(plain)).max()
    assert term.admissible(deep, np.array([0.8 / 0.25]))
    assert not term.admissible(deep, np.array([0.4 / 0.25]))
    assert not term.admissible(plain, np.array([1.2]))
    # So it does by the heat of the force.
    hot, knee = (term.columns((3.0, 1.0, k))[:, 0] for k in (1.0, 0.25))
    assert 0.0 < np.abs(knee).max() < 0.5 * np.abs(hot).max()
    # At a quarter of the largest force the loss has come to four fifths.
    sag = term.parameters(deep, np.array([0.8 / 0.25]))['sag_force']
    assert sag * 0.25 * force.max() == pytest.approx(0.8)


def test_a_torque_that_sags_in_several_ways_down_to_a_fifth_is_named(planted: Maker) -> None:
    truth = {'sag_square': 2e-4, 'sag_speed': 1.5, 'sag_heat': 4e-3, 'heat_time': 8.0}
    found = diagnose([planted({'torque_sag.x': truth}, duration=14.0, seed=1)], [], nominal())
    assert found.verdict == ['torque_sag.x']
    for name, value in truth.items():
        # The shares imitate one another: the loop's gap is flat along them.
        assert found.effects['torque_sag.x'][name] == pytest.approx(value, rel=torque_sag.DOUBT)


def test_friction_that_goes_with_the_position_is_named_with_its_curve(planted: Maker) -> None:
    name = 'position_dependent_friction.x'
    ends = {'start': -0.03, 'stop': 0.03}
    session = planted({name: {**LEVELS, **ends, 'presliding': 2e-6}}, duration=16.0)
    found = diagnose([session], [], nominal())
    assert found.verdict == [name]
    values = {key: value for key, (value, _) in found.parameters[name].items()}
    estimated = np.linspace(values['start'], values['stop'], len(LEVELS))
    where = np.linspace(-0.02, 0.02, 9)
    level = np.interp(where, estimated, [values[key] for key in LEVELS])
    planted_level = np.interp(where, np.linspace(-0.03, 0.03, len(LEVELS)), list(LEVELS.values()))
    np.testing.assert_allclose(level, planted_level, rtol=0.1)


def test_a_friction_that_coarse_knots_do_not_follow(planted: Maker) -> None:
    name, middles = 'position_dependent_friction.x', (2.0, -2.0, 1.5, -1.5, 2.0, -1.0)
    between = {f'm{k}': m for k, m in enumerate(middles)}
    truth = {**LEVELS, **between, 'start': -0.03, 'stop': 0.03, 'presliding': 2e-6}
    found = diagnose([planted({name: truth}, duration=16.0)], [], nominal())
    assert found.verdict == [name]
    told = {key: value for key, (value, _) in found.parameters[name].items()}
    places = np.linspace(-0.02, 0.02, 40)
    level, true_level = (
        [position_dependent_friction.sliding(p, v['start'], v['stop'], *_knots(v)) for p in places]
        for v in (told, truth)
    )
    assert np.std(np.subtract(level, true_level)) < 0.25


def _knots(values: dict[str, float]) -> list[Array]:
    return [
        np.array([values.get(f'{letter}{k}', 0.0) for k in range(number)])
        for letter, number in (('c', 7), ('m', 6), ('q', 12))
    ]


def test_a_friction_whose_straight_lines_dip_below_none_is_one_of_the_position(
    planted: Maker,
) -> None:
    session, twin = planted({}, duration=8.0), nominal()
    term = (
        Servo([load_record(session, twin)], twin, 'x')
        .problem()
        .terms['position_dependent_friction.x']
    )
    dips = np.array([6.0, 7.0, 3.0, -0.5, 3.0, 7.0, 6.0])
    assert term.admissible((2e-6,), dips)
    assert min(value for key, value in term.parameters((2e-6,), dips).items() if 'c' in key) == 0.0
    assert not term.admissible((2e-6,), np.where(dips < 0.0, -4.0, dips))
    assert not term.admissible((2e-6,), np.full(7, 6.0))


def test_a_base_on_soft_mounts_is_named_and_what_makes_the_same_force_beside_it(
    planted: Maker,
) -> None:
    values = {'frequency': 9.5, 'damping': 0.05, 'mass_ratio': 0.12}
    session = planted({'base_resonance.x': values}, duration=12.0)
    found = diagnose([session], [], nominal())
    assert found.verdict == ['base_resonance.x']
    assert 'structural_resonance.x' in found.causes[0].alternatives
    for name in ('frequency', 'mass_ratio'):
        assert found.parameters['base_resonance.x'][name][0] == pytest.approx(
            values[name], rel=0.1
        )


def test_the_tracker_may_see_any_share_of_the_motion_of_a_base(planted: Maker) -> None:
    values = {'frequency': 7.0, 'damping': 0.03, 'mass_ratio': 0.13, 'floor_share': 0.7}
    session = planted({'base_resonance.x': values}, duration=12.0)
    found = diagnose([session], [], nominal())
    assert found.verdict == ['base_resonance.x']
    share = found.parameters['base_resonance.x']['floor_share'][0]
    assert share == pytest.approx(values['floor_share'], rel=0.1)


def test_a_base_is_named_at_any_frequency_where_the_tracker_stands_on_the_floor(
    planted: Maker,
) -> None:
    values = {'frequency': 20.0, 'damping': 0.05, 'mass_ratio': 0.3, 'floor_share': 1.0}
    session = planted({'base_resonance.x': values}, duration=12.0)
    found = diagnose([session], [], nominal())
    assert found.verdict == ['base_resonance.x']
    values = {key: value for key, (value, _) in found.parameters['base_resonance.x'].items()}
    assert values['frequency'] == pytest.approx(20.0, rel=0.05)
    # The tracker sees their product, so that a share of the table needs the refined mass ratio.
    assert values['mass_ratio'] == pytest.approx(0.3, rel=0.05)
    assert values['floor_share'] == pytest.approx(1.0, rel=0.05)


def test_a_force_limit_and_the_friction_that_it_hides(planted: Maker) -> None:
    truth = {'force_saturation.x': {'limit': 20.0}, 'viscous_friction.x': {'viscous': 300.0}}
    found = diagnose([planted(truth, duration=16.0)], [], nominal())
    assert sorted(found.verdict) == sorted(truth)
    for name, values in truth.items():
        for key, value in values.items():
            assert found.parameters[name][key][0] == pytest.approx(value, rel=1e-3)
