"""A rig with recorded force: a simulated record is explained by the twin that made it."""

from dataclasses import replace

import numpy as np
import pytest

from stage_core.errors import StageError
from stage_core.twin_file import ForceAxis, ServoAxis, TwinFile
from stage_twin.measured_force import (
    required_force,
    simulate_measured_force,
    smooth_motion,
)
from stage_twin.simulate import simulate

PERIOD = 1e-3
UNIT = 35.15
EFFECTS = {
    'none': {},
    'creep': {'coulomb_friction.x': {'coulomb': 15.0, 'creep_velocity': 1e-3}},
    'friction': {'coulomb_friction.x': {'coulomb': 15.0, 'presliding': 10e-6}},
    'asymmetry': {'asymmetric_friction.x': {'viscous_positive': 60.0, 'presliding': 10e-6}},
    'loads': {'force_ripple.x': {}, 'cable_force.x': {}, 'force_offset.x': {}},
    'drive': {'drive_gain.x': {'error': 0.2}, 'inertia_mismatch.x': {'ratio': -0.1}},
    'delay': {'actuation_delay.x': {'delay': 0.0045}},
    'resonance': {'structural_resonance.x': {'frequency': 15.0, 'damping': 0.1}},
}


def record(effects):
    """Position [m] and force [N] of a servo session in closed loop, (n, 1) each."""
    axis = replace(ServoAxis(18.0, 40.0), encoder_resolution=1e-10)
    t = np.arange(2000) * PERIOD
    reference = (0.03 * np.sin(5.0 * t) ** 3)[:, None]
    result = simulate(
        TwinFile('servo', {'x': axis}, PERIOD, effects=effects),
        reference,
        np.gradient(reference, PERIOD, axis=0),
    )
    return result.encoder, result.force


def rig(effects, unit=1.0):
    return TwinFile('measured_force', {'x': ForceAxis(18.0, 40.0, unit)}, PERIOD, effects=effects)


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


@pytest.mark.parametrize('name', EFFECTS)
def test_the_right_twin_explains_the_record(name):
    position, force = record(EFFECTS[name])
    result = simulate_measured_force(rig(EFFECTS[name]), position, force)
    # Start and end of the record have no smooth derivative.
    inner = slice(60, -60)
    assert rms((result.required - force)[inner]) < 0.03 * rms(force)
    assert rms((result.encoder - position)[inner]) < 2e-6
    if EFFECTS[name]:
        wrong = simulate_measured_force(rig({}), position, force)
        assert rms((wrong.required - force)[inner]) > 4.0 * rms((result.required - force)[inner])
        assert rms((wrong.encoder - position)[inner]) > 4.0 * rms(
            (result.encoder - position)[inner]
        )


def test_windows_start_from_the_smoothed_record():
    position, force = record({})
    result = simulate_measured_force(rig({'drive_gain.x': {'error': 0.3}}), position, force)
    starts = smooth_motion(position, PERIOD)
    np.testing.assert_array_equal(result.encoder[::100], starts.position[::100])
    np.testing.assert_array_equal(result.velocity[::100], starts.velocity[::100])
    error = np.abs(result.encoder - position)[:, 0].reshape(-1, 100)
    # Wrong force: the error grows within windows and is taken back at each start.
    assert np.all(error[2:-1, 99] > error[2:-1, 0])


def test_effort_unit_turns_volts_into_newtons():
    position, force = record({})
    volts = simulate_measured_force(rig({}, UNIT), position, force / UNIT)
    np.testing.assert_allclose(volts.force, force, rtol=1e-12)


def test_smoothing_keeps_a_cubic_and_its_derivatives():
    t = np.arange(100)[:, None] * PERIOD
    motion = smooth_motion(t**3 - 0.1 * t, PERIOD)
    np.testing.assert_allclose(motion.position, t**3 - 0.1 * t, atol=1e-13)
    np.testing.assert_allclose(motion.velocity, 3.0 * t**2 - 0.1, atol=1e-10)
    np.testing.assert_allclose(motion.acceleration, 6.0 * t, atol=1e-6)


def test_wrong_records_are_named():
    with pytest.raises(StageError, match='too few'):
        required_force(rig({}), np.zeros((5, 1)))
    with pytest.raises(StageError, match='not finite'):
        required_force(rig({}), np.full((50, 1), np.nan))
    with pytest.raises(StageError, match=r'effort has shape \(40, 1\)'):
        simulate_measured_force(rig({}), np.zeros((50, 1)), np.zeros((40, 1)))
