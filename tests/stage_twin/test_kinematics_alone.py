"""A motor path carried to the table gives what the whole twin gives."""

from dataclasses import replace

import numpy as np
import pytest

from stage_core.errors import StageError
from stage_core.twin_file import TwinFile
from stage_twin.kinematics import carry
from stage_twin.simulate import simulate
from stage_twin.stepper import StepperPlant

EFFECTS = {
    'backlash.x': {},
    'backlash.y': {'width': 4e-6},
    'cyclic_pitch_error.y': {},
    'nonorthogonality': {},
    'straightness.x': {},
    'angular_error.y': {},
    'scale_error.x': {},
    'thermal_expansion.x': {'heating': 200.0, 'time_constant': 3.0},
}


def test_the_motor_path_of_a_session_gives_its_table():
    twin = TwinFile.nominal_servo().with_effects(EFFECTS)
    axes = {name: replace(axis, encoder_resolution=1e-13) for name, axis in twin.axes.items()}
    twin = replace(twin, axes=axes)
    t = np.arange(1500) * 1e-3
    reference = 0.02 * np.stack([1.0 - np.cos(4.0 * t), np.sin(3.0 * t)], axis=1)
    whole = simulate(twin, reference, np.gradient(reference, 1e-3, axis=0))
    # Within a tick the motor may turn; a tick's mean speed differs from its speed at the start.
    np.testing.assert_allclose(carry(twin, whole.encoder), whole.table, atol=5e-9)
    recorded = carry(twin, whole.encoder, whole.temperatures)
    np.testing.assert_allclose(recorded, whole.table, atol=2e-9)


def test_steps_of_a_stepper_give_its_table():
    kinematic = {name: values for name, values in EFFECTS.items() if 'thermal' not in name}
    twin = TwinFile.from_dict(
        {'kind': 'stepper', 'axes': {'x': {}, 'y': {}}, 'effects': kinematic}
    )
    plant = StepperPlant(twin)
    plant.move_abs(0, 200_000)
    plant.move_abs(1, -90_000)
    motor, table = [], []
    for k in range(1500):
        if k == 800:
            plant.move_abs(0, 50_000)
        plant.advance_to(k * twin.control_period)
        motor.append([plant.position_steps(i) * plant.twin.axes['x'].microstep for i in (0, 1)])
        table.append(plant.table())
    np.testing.assert_allclose(carry(twin, np.array(motor)), np.array(table), atol=1e-14)


def test_a_wrong_path_is_named():
    with pytest.raises(StageError, match='motor has shape'):
        carry(TwinFile.nominal_servo(), np.zeros((5, 1)))
