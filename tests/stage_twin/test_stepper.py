"""The stepper plant: planned motion, limits, play, scatter, and the tracker on it."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stage_core.errors import StageError
from stage_core.twin_file import TwinFile
from stage_twin.profile import plan_move
from stage_twin.stepper import StepperPlant

MICROSTEP = 0.047625e-6


def twin(**content):
    return TwinFile.from_dict(
        {'kind': 'stepper', 'axes': {'x': {}, 'y': {}}, 'tracker': {'noise': 0.0}, **content}
    )


def test_facts_of_paper_1_are_the_defaults():
    axis = twin().axes['x']
    assert axis.microstep == MICROSTEP
    assert axis.max_speed == 0.104
    # 12800 microsteps make one turn of the screw.
    assert axis.lead == pytest.approx(12800 * MICROSTEP)


@pytest.mark.parametrize(('steps', 'speed'), [(600_000, 200_000.0), (3_000, 200_000.0)])
def test_a_move_takes_the_time_of_its_trapezoid(steps, speed):
    acceleration = 1e6
    plant = StepperPlant(twin())
    plant.move_abs(0, steps, speed, acceleration)
    cruises = steps > speed**2 / acceleration
    duration = (
        steps / speed + speed / acceleration if cruises else 2.0 * np.sqrt(steps / acceleration)
    )
    plant.advance_to(duration - 1e-4)
    assert plant.busy(0)
    plant.advance_to(duration + 1e-9)
    assert not plant.busy(0)
    assert plant.position_steps(0) == steps
    assert not plant.busy(1)
    np.testing.assert_allclose(plant.table(), [steps * MICROSTEP, 0.0], atol=1e-15)


@settings(max_examples=60, deadline=None)
@given(
    st.floats(-1e5, 1e5),
    st.floats(-2e5, 2e5),
    st.floats(-1e5, 1e5),
    st.floats(1e3, 2e5),
    st.floats(1e5, 1e7),
)
def test_any_state_reaches_any_target(position, velocity, target, speed, acceleration):
    pieces = plan_move(1.0, position, velocity, target, speed, acceleration)
    time, here, now = 1.0, position, velocity
    for piece in pieces:
        assert piece.start == pytest.approx(time)
        assert piece.position == pytest.approx(here, abs=1e-3)
        assert piece.velocity == pytest.approx(now, abs=1e-2 + 1e-7 * abs(now))
        assert abs(piece.acceleration) <= acceleration
        time = piece.end
        here, now = piece.at(time)
        assert abs(now) <= max(speed, abs(velocity)) * (1.0 + 1e-9) + 1e-6
        # No piece reverses: extremes of the path lie at the ends of pieces.
        assert piece.velocity * now >= -1e-4
    assert here == pytest.approx(target, abs=1e-3)
    assert now == pytest.approx(0.0, abs=1e-2)


def test_speed_is_held_to_the_file_s_limit():
    plant = StepperPlant(twin())
    plant.move_abs(0, 10**8, speed=1e9)
    plant.advance_to(1.0)
    assert plant.velocity_steps(0) * MICROSTEP == pytest.approx(0.104)
    plant.stop(0)
    plant.advance_to(3.0)
    assert not plant.busy(0)
    # 0.5 m/s^2: ramp up and down each cover v^2 / 2a.
    ramp = 0.104**2 / (2.0 * 0.5)
    expected = ramp + 0.104 * (1.0 - 0.104 / 0.5) + ramp
    assert plant.position_steps(0) * MICROSTEP == pytest.approx(expected, abs=2 * MICROSTEP)


def test_the_path_does_not_depend_on_when_it_is_looked_at():
    coarse, fine = (StepperPlant(twin(effects={'backlash.x': {}})) for _ in range(2))
    for plant, step in ((coarse, 0.25), (fine, 0.01)):
        for target, until in ((90_000, 0.5), (-20_000, 1.0)):
            plant.move_abs(0, target, 3e5, 5e6)
            for time in np.arange(until - 0.5 + step, until + step / 2, step):
                plant.advance_to(time)
    np.testing.assert_allclose(coarse.table(), fine.table(), atol=1e-15)
    assert coarse.table()[0] == pytest.approx(-20_000 * MICROSTEP + 5e-6, abs=1e-12)


def test_kinematic_effects_bend_the_table():
    plant = StepperPlant(twin(effects={'nonorthogonality': {'angle': 1e-3}}))
    plant.move_abs(1, 100_000)
    table = plant.table(10.0)
    y = 100_000 * MICROSTEP
    np.testing.assert_allclose(table, [-np.sin(1e-3) * y, np.cos(1e-3) * y], atol=1e-15)


def test_repeatability_is_four_deviations_of_where_a_move_ends():
    plant = StepperPlant(twin(repeatability=3e-6), seed=2)
    ends, time = [], 0.0
    for index in range(400):
        target = 2_000 * (index % 2)
        plant.move_abs(0, target)
        time += 1.0
        ends.append(plant.table(time)[0] - target * MICROSTEP)
    # Three standard errors of a standard deviation from 400 values.
    assert np.std(ends) == pytest.approx(0.75e-6, rel=3.0 / np.sqrt(800.0))
    again = StepperPlant(twin(repeatability=3e-6), seed=2)
    again.move_abs(0, 0)
    again.move_abs(0, 2_000)
    assert again.table(1.0)[0] != 2_000 * MICROSTEP


def test_the_tracker_sees_an_older_table():
    plant = StepperPlant(twin(effects={'tracker_latency': {'latency': 0.05}}))
    plant.move_abs(0, 10**6, 100_000.0, 1e9)
    for time in np.arange(0.0, 0.5, 0.001):
        plant.advance_to(time)
    stamp, point = plant.tracker_point(0.5)
    assert stamp == 0.5
    assert point[0] == pytest.approx(0.45 * 100_000 * MICROSTEP, abs=10 * MICROSTEP)


@pytest.mark.parametrize('value', [-1.0, 'much', float('nan')])
def test_a_wrong_repeatability_is_named(value):
    with pytest.raises(StageError, match='repeatability must be'):
        StepperPlant(twin(repeatability=value))


def test_a_servo_twin_is_refused():
    with pytest.raises(StageError, match='this twin file is servo'):
        StepperPlant(TwinFile.nominal_servo())
