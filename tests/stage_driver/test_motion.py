"""Profiles and the motion generator: limits kept at every tick, exact landing, smooth changes."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from stage_core.errors import StageError
from stage_core.twin_file import TwinFile
from stage_driver import servo_loop
from stage_driver.limits import AxisLimits, SetpointKind, check_setpoint
from stage_driver.motion import Mode, MotionGenerator
from stage_driver.profile import braking_speed, step_to_target

PERIOD = 0.001
LIMITS = AxisLimits(-0.1, 0.1, 0.2, 2.0, 4.0)
GAINS = servo_loop.loop_gains(TwinFile.nominal_servo(), ('x',))


def generator(start=0.0, jerk=100.0):
    made = MotionGenerator([LIMITS], GAINS, PERIOD, jerk, 0.0)
    made.hold(np.array([start]))
    return made


def setpoint(position=None, velocity=None):
    return check_setpoint(
        ('x',),
        (LIMITS,),
        1,
        ['x'],
        [] if position is None else [position],
        [] if velocity is None else [velocity],
    )


def follow(made, ticks=5000):
    """Tick with a perfect axis until a motion ends; references per tick."""
    references = [made.reference[0]]
    if made.at_rest:
        return np.array(references)
    for _ in range(ticks):
        done = made.tick(made.reference.copy())
        references.append(made.reference[0])
        if done:
            return np.array(references)
    raise AssertionError('the motion did not end')


@given(st.floats(-0.1, 0.1), st.floats(-0.1, 0.1), st.floats(0.01, 0.2), st.floats(0.1, 5.0))
@example(0.0, 1e-9, 0.2, 5.0)
@settings(max_examples=60, deadline=None)
def test_trapezoid_keeps_its_limits_and_lands_exactly(start, target, limit, acceleration):
    position, speed = start, 0.0
    for _ in range(40000):
        before = speed
        position, speed = step_to_target(position, speed, target, limit, acceleration, PERIOD)
        assert abs(speed) <= limit * (1 + 1e-9)
        assert abs(speed - before) <= acceleration * PERIOD * (1 + 1e-6)
        assert min(start, target) - 1e-12 <= position <= max(start, target) + 1e-12
        if position == target and speed == 0.0:
            break
    assert position == target and speed == 0.0


@given(st.floats(1e-7, 0.1), st.floats(0.1, 10.0))
@settings(max_examples=60, deadline=None)
def test_braking_speed_stops_within_the_distance_and_wastes_none(distance, acceleration):
    speed = braking_speed(distance, acceleration, PERIOD)
    travelled, ticks = 0.0, 0
    while speed > 0.0:
        travelled += speed * PERIOD
        speed -= acceleration * PERIOD
        ticks += 1
    assert travelled == pytest.approx(distance, rel=1e-6, abs=1e-12)


@pytest.mark.parametrize('target', [0.1, -0.03, 1e-6])
def test_moves_keep_speed_acceleration_and_jerk(target):
    made = generator()
    made.take(setpoint(target), made.reference)
    path = follow(made)
    speed = np.diff(path) / PERIOD
    acceleration = np.diff(speed) / PERIOD
    jerk = np.diff(acceleration) / PERIOD
    assert path[-1] == target
    assert np.abs(speed).max() <= 0.2 * (1 + 1e-9)
    assert np.abs(acceleration).max() <= 2.0 * (1 + 1e-6)
    # An average over n ticks turns a step a into n steps of a / n.
    assert np.abs(jerk).max() <= 2 * 100.0 * (1 + 1e-6)


def test_a_full_move_is_not_needlessly_slow():
    made = generator()
    made.take(setpoint(0.1), made.reference)
    # 0.1 m at 0.2 m/s and 2 m/s^2: 0.6 s; the jerk limit adds 0.02 s.
    assert len(follow(made)) * PERIOD == pytest.approx(0.62, abs=0.005)


@given(st.lists(st.tuples(st.floats(-0.1, 0.1), st.integers(2, 300)), min_size=1, max_size=5))
@settings(max_examples=25, deadline=None)
def test_retargeted_moves_stay_smooth_and_within_the_limits(plan):
    made = generator()
    path = [0.0]
    for target, ticks in plan:
        made.take(setpoint(target), made.reference)
        for _ in range(ticks):
            made.tick(made.reference.copy())
            path.append(made.reference[0])
    path.extend(follow(made)[1:])
    speed = np.diff(path) / PERIOD
    assert path[-1] == plan[-1][0]
    assert np.abs(np.diff(speed)).max() <= 2.0 * PERIOD * (1 + 1e-6)
    assert np.abs(path).max() <= 0.1 + 0.2**2 / 2.0


def test_velocity_ramps_and_a_stop_takes_its_deceleration_distance():
    made = generator(-0.05)
    made.take(setpoint(velocity=0.1), made.reference)
    for _ in range(200):
        made.tick(made.reference.copy())
    assert made.command[0] == pytest.approx(0.1)
    begin = made.reference[0]
    made.stop(made.reference)
    path = follow(made)
    assert path[-1] - begin == pytest.approx(0.1**2 / (2 * 4.0), abs=2e-4)
    assert made.mode is Mode.HOLD


def test_velocity_never_leaves_the_soft_limits():
    made = generator(0.05)
    made.take(setpoint(velocity=0.2), made.reference)
    for _ in range(2000):
        made.tick(made.reference.copy())
        assert made.reference[0] <= 0.1 + 1e-12
    assert made.reference[0] == pytest.approx(0.1, abs=1e-6)
    assert made.clamped > 0


def test_stream_of_both_is_passed_on_tick_by_tick():
    made = generator()
    for k in range(1, 20):
        made.take(setpoint(0.0001 * k, 0.1), made.reference)
        made.tick(np.array([0.0001 * k]))
        assert made.reference[0] == 0.0001 * k
        assert made.command[0] == 0.1
        assert made.speed[0] == pytest.approx(0.1)


def test_position_after_a_stream_goes_on_with_the_same_velocity_command():
    made = generator()
    encoder = np.array([0.02])
    for k in range(5):
        made.take(setpoint(0.02 + k * 1e-4, 0.1), encoder)
        encoder[0] = 0.02 + k * 1e-4
        made.tick(encoder)
    made.take(setpoint(0.05), encoder)
    made.tick(encoder + 1e-4)
    command = np.zeros(1)
    servo_loop.position_loop(made.reference, made.speed, encoder + 1e-4, GAINS, command)
    assert made.follows_reference
    assert command[0] == pytest.approx(0.1, abs=0.01)


def test_axes_not_named_stay_where_they_are_going():
    limits = [LIMITS, LIMITS]
    gains = servo_loop.loop_gains(TwinFile.nominal_servo(), ('x', 'y'))
    made = MotionGenerator(limits, gains, PERIOD, 100.0, 0.0)
    made.hold(np.zeros(2))
    first = check_setpoint(('x', 'y'), limits, 0, ['y', 'x'], [0.02, 0.01], [])
    second = check_setpoint(('x', 'y'), limits, 0, ['y'], [0.03], [])
    made.take(first, made.reference)
    for _ in range(50):
        made.tick(made.reference.copy())
    made.take(second, made.reference)
    while not made.tick(made.reference.copy()):
        pass
    assert made.reference.tolist() == [0.01, 0.03]


def test_setpoint_kinds():
    assert setpoint(0.0).kind is SetpointKind.POSITION
    assert setpoint(velocity=0.0).kind is SetpointKind.VELOCITY
    assert setpoint(0.0, 0.0).kind is SetpointKind.BOTH


@pytest.mark.parametrize(
    ('changes', 'words'),
    [({'lower': 0.2}, 'limit_lower'), ({'max_velocity': 0.0}, 'x.max_velocity')],
)
def test_impossible_limits_are_refused(changes, words):
    values = {
        'lower': -0.1,
        'upper': 0.1,
        'max_velocity': 0.1,
        'max_acceleration': 1.0,
        'stop_deceleration': 1.0,
    }
    with pytest.raises(StageError, match=words):
        AxisLimits(**{**values, **changes}).checked('x')


def test_lugre_compensation_holds_the_coulomb_force_at_speed_and_changes_sign_smoothly():
    friction = np.array([[20.0, 30.0, 0.001, 2e-6]])
    bristles, out = np.zeros(1), np.zeros(1)
    forces = []
    for speed in [0.0] * 3 + [0.05] * 50 + [-0.05] * 50:
        out[:] = 0.0
        servo_loop.lugre_velocity(np.array([speed]), bristles, friction, GAINS, PERIOD, out)
        forces.append(out[0] * 3600.0)
    assert forces[2] == 0.0
    assert forces[52] == pytest.approx(20.0, rel=1e-6)
    assert forces[-1] == pytest.approx(-20.0, rel=1e-6)
