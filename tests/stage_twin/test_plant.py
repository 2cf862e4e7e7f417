"""The plant tick by tick against the simulation of a whole session."""

from dataclasses import replace

import numpy as np
import pytest

from stage_core.errors import StageError
from stage_core.twin_file import TwinFile
from stage_twin.effects import EFFECTS as LIBRARY
from stage_twin.plant import ServoPlant
from stage_twin.simulate import simulate

EFFECTS = {
    'actuation_delay.x': {'delay': 0.0027},
    'coulomb_friction.x': {},
    'stribeck_friction.y': {},
    'structural_resonance.y': {'table_share': 1.0},
    'backlash.x': {},
    'thermal_expansion.y': {},
    'cyclic_pitch_error.x': {},
    'angular_error.x': {},
    'tracker_misalignment': {'angle': 0.2, 'offset_x': 1.0},
    'tracker_latency': {'latency': 0.0123},
    'tracker_clock_drift': {},
}


def twin_with_effects():
    return TwinFile.nominal_servo().with_effects(EFFECTS)


def session(count=400):
    t = np.arange(count) * 1e-3
    reference = np.stack([0.01 + 0.02 * np.sin(6.0 * t), 0.01 * np.cos(9.0 * t)], axis=1)
    return reference, np.gradient(reference, 1e-3, axis=0)


def test_ticks_give_the_session():
    reference, rate = session()
    whole = simulate(twin_with_effects(), reference, rate, noise=False)
    plant = ServoPlant(twin_with_effects())
    plant.reset(reference[0])
    sample = 1
    for k in range(len(reference) - 1):
        np.testing.assert_array_equal(plant.encoder(), whole.encoder[k])
        np.testing.assert_array_equal(plant.table(), whole.table[k])
        np.testing.assert_allclose(plant.temperatures(), whole.temperatures[k], rtol=1e-15)
        plant.step(whole.force[k])
        if sample < len(whole.tracker_stamps) and k + 1 == 10 * sample:
            stamp, point = plant.tracker_point(plant.time, noise=False)
            assert stamp == pytest.approx(whole.tracker_stamps[sample], abs=1e-12)
            np.testing.assert_allclose(point, whole.tracker_points[sample], atol=1e-10)
            sample += 1
    assert plant.time == pytest.approx(0.399)
    assert sample == 40


def test_warming_up_changes_nothing():
    plant = ServoPlant(twin_with_effects())
    plant.reset([0.01, 0.02])
    for _ in range(20):
        plant.step([50.0, -20.0])
    before = plant.time, plant.encoder().copy(), plant.table().copy()
    plant.warm_up()
    assert plant.time == before[0]
    np.testing.assert_array_equal(plant.encoder(), before[1])
    np.testing.assert_array_equal(plant.table(), before[2])


def test_reset_forgets_forces_still_on_their_way():
    plant = ServoPlant(twin_with_effects())
    plant.step([500.0, 500.0])
    plant.reset([0.0, 0.0])
    for _ in range(5):
        plant.step([0.0, 0.0])
    assert not plant.encoder().any()


def plant_of_period(period, effects=None):
    twin = TwinFile.nominal_servo().with_effects(effects or {})
    return ServoPlant(replace(twin, control_period=period))


@pytest.mark.parametrize('count', [1, 2, 7, 40, 800])
def test_a_held_force_does_not_care_about_the_length_of_ticks(count):
    # The discretisation is exact: the same time under the same force, however divided.
    divided, whole = plant_of_period(1e-4), plant_of_period(count * 1e-4)
    for _ in range(count):
        divided.step([30.0, -12.0])
    whole.step([30.0, -12.0])
    np.testing.assert_allclose(divided.table(), whole.table(), rtol=1e-11)
    np.testing.assert_allclose(divided.motor_velocity(), whole.motor_velocity(), rtol=1e-11)


def test_the_tracker_s_noise_follows_the_seed():
    twin = TwinFile.nominal_servo()
    first, same, other = (ServoPlant(twin, seed=seed) for seed in (3, 3, 4))
    point = first.tracker_point(0.0)[1]
    np.testing.assert_array_equal(point, same.tracker_point(0.0)[1])
    assert not np.array_equal(point, other.tracker_point(0.0)[1])
    quiet = replace(twin, tracker=replace(twin.tracker, noise=0.0))
    assert not ServoPlant(quiet).tracker_point(0.0)[1].any()


def test_a_stepper_twin_is_refused():
    twin = TwinFile.from_dict({'kind': 'stepper', 'axes': {'x': {}}})
    with pytest.raises(StageError, match='kind servo'):
        ServoPlant(twin)


@pytest.mark.parametrize('period', [1e-4, 2.3e-4, 1e-3])
def test_the_delay_is_a_time_whatever_the_length_of_ticks(period):
    plant = plant_of_period(period, {'actuation_delay.x': {'delay': 0.0023}})
    axis = plant.twin.servo('x')
    for _ in range(60):
        under_way = max(plant.time - 0.0023, 0.0)
        expected = 20.0 / axis.viscous * -np.expm1(-axis.viscous / axis.mass * under_way)
        assert plant.motor_velocity()[0] == pytest.approx(expected, rel=1e-9, abs=1e-12)
        plant.step([20.0, -5.0])


def test_a_base_on_mounts_moves_encoder_and_table_as_a_load_on_a_spring_does():
    base = {'frequency': 12.0, 'damping': 0.05, 'mass_ratio': 0.2, 'floor_share': 1.0}
    load = {'frequency': 12.0, 'damping': 0.05, 'mass_ratio': 0.2, 'table_share': 0.2}
    assert LIBRARY['base_resonance'].same(base) == ('structural_resonance',)
    assert LIBRARY['structural_resonance'].same(load) == ('base_resonance',)
    assert LIBRARY['structural_resonance'].same({**load, 'table_share': 1.0}) == ()
    twin, (reference, rate) = TwinFile.nominal_servo(), session(2000)
    one, other, none = (
        simulate(twin.with_effects(effects), reference, rate, noise=False)
        for effects in ({'base_resonance.x': base}, {'structural_resonance.x': load}, {})
    )
    for name in ('encoder', 'table'):
        ways = [getattr(result, name)[:, 0] for result in (one, other, none)]
        moved = np.abs(ways[0] - ways[2]).max()
        assert np.abs(ways[0] - ways[1]).max() < max(0.02 * moved, 1.1e-6)  # one count
