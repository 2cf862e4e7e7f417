"""The servo backend against a small independent plant over the drive link."""

import math
import threading
import time

import pytest

from stage_core import drive_link
from stage_core.errors import StageError
from stage_core.twin_file import TwinFile
from stage_driver.states import State

from ..patience import PATIENCE
from .servo_rig import move, quiet, rig, stream


def test_position_move_lands_on_target_and_the_world_is_quiet_after_it():
    with rig() as (plant, backend, recorder):
        move(backend, recorder, 0.01, -0.02)
        assert plant.position == pytest.approx([0.01, -0.02], abs=3e-6)
        ticks = plant.tick
        time.sleep(0.2)
        # The last force may have been on its way.
        assert plant.tick <= ticks + 1
        speeds = [max(map(abs, rates)) for _, _, rates, _, _ in recorder.controls]
        assert 0.1 < max(speeds) <= 0.2 + 1e-9
        assert recorder.temperatures[0][1] == drive_link.SENSORS


def test_a_move_is_the_same_run_to_run():
    traces = []
    for _ in range(2):
        with rig() as (_, backend, recorder):
            move(backend, recorder, 0.004, 0.002)
            traces.append(recorder.controls)
    assert traces[0] == traces[1]


def test_published_values_are_those_of_the_equations():
    """F_k, vf_k and vc_k recomputed from the published columns alone."""
    with rig() as (_, backend, recorder):
        move(backend, recorder, 0.01, 0.0)
        states, controls = recorder.states, recorder.controls
    x = TwinFile.nominal_servo().servo('x')
    a = math.exp(-0.001 * x.velocity_filter)
    filtered, previous, integral = 0.0, states[0][1][0], 0.0
    for (stamp, q, vf), (control_stamp, r, _, vc, force) in zip(states, controls, strict=False):
        assert stamp == control_stamp
        filtered = a * filtered + (1 - a) * (q[0] - previous) / 0.001
        previous = q[0]
        assert vf[0] == pytest.approx(filtered, abs=1e-12)
        assert vc[0] == pytest.approx(x.position_gain * (r[0] - q[0]), abs=1e-12)
        wanted = x.velocity_gain * (vc[0] - filtered) + integral
        assert force[0] == pytest.approx(max(-600.0, min(600.0, wanted)), abs=1e-9)
        if abs(wanted) <= 600.0:
            integral += x.integral_gain * (vc[0] - filtered) * 0.001


def test_homing_goes_to_the_reference_position_and_is_required():
    with rig(start=(0.003, -0.002), home_required=True) as (plant, backend, recorder):
        backend.submit(0, ['x'], [0.01], [])
        recorder.wait(lambda: recorder.said('not homed'))
        assert plant.tick == 0
        assert 'homed' in backend.home().result()
        assert plant.position == pytest.approx([0.0, 0.0], abs=3e-6)
        assert backend.status().homed


def test_velocity_stream_waits_for_each_setpoint_and_ends_with_a_position():
    with rig() as (plant, backend, recorder):
        stream(backend, recorder, 200, lambda k, q: ([], [0.02, -0.01]))
        assert plant.tick == 200
        time.sleep(0.1)
        assert plant.tick == 200
        backend.submit(recorder.states[-1][0], ['x', 'y'], [0.01, 0.0], [])
        recorder.wait(lambda: len(recorder.controls) > 250)
        quiet(backend, recorder)
        assert plant.position == pytest.approx([0.01, 0.0], abs=3e-6)
        assert recorder.controls[199][3] == pytest.approx((0.02, -0.01))


def test_stream_of_both_follows_reference_and_ignores_duplicates():
    with rig() as (plant, backend, recorder):

        def circle(k, q):
            angle = 2 * math.pi * k / 1000
            r = (0.005 * (1 - math.cos(angle)), 0.005 * math.sin(angle))
            v = (10 * math.pi * math.sin(angle) * 1e-3, 10 * math.pi * math.cos(angle) * 1e-3)
            return r, [40 * (r[i] - q[i]) + v[i] for i in range(2)]

        stream(backend, recorder, 300, circle)
        stamp = recorder.states[-1][0]
        assert plant.tick == 300
        assert backend.status().details['rival_setpoints'] == '0'
        last = recorder.controls[-1]
        # The same again got lost, another one for the same tick is another controller's.
        for position in (last[1], [0.0, 0.0]):
            backend.submit(last[0], ['x', 'y'], position, last[3])
        backend.enable(True).result()  # served after both
        assert backend.status().details['rival_setpoints'] == '1'
        time.sleep(0.05)
        assert recorder.states[-1][0] == stamp
        assert recorder.controls[-1] == last
        assert last[1] == pytest.approx(circle(299, (0, 0))[0])
        assert plant.position == pytest.approx(last[1], abs=2e-4)


def test_stream_whose_controller_died_is_stopped():
    with rig(lockstep_timeout=0.2) as (plant, backend, recorder):
        stream(backend, recorder, 300, lambda k, q: ([], [0.05, 0.0]))
        recorder.wait(lambda: recorder.said('stream ended'))
        quiet(backend, recorder)
        assert abs(plant.velocity[0]) < 1e-3
        assert backend.status().state is State.READY


@pytest.mark.parametrize(
    ('names', 'positions', 'velocities', 'words'),
    [
        (['x'], [float('nan')], [], 'position of x is nan'),
        (['y'], [], [float('inf')], 'velocity of y is inf'),
        (['x', 'y'], [0.0, 0.06], [], 'position of y 0.060000 m is outside its limits -0.05'),
        (['x'], [], [0.3], 'velocity of x 0.300000 m/s is beyond its limit 0.2'),
        (['z'], [0.0], [], "'z'"),
        (['x', 'y'], [0.0], [], '1 positions for 2 names'),
        (['x'], [], [], 'neither positions nor velocities'),
    ],
)
def test_bad_setpoints_are_refused_by_name_and_move_nothing(names, positions, velocities, words):
    with rig() as (plant, backend, recorder):
        for _ in range(50):
            backend.submit(0, names, positions, velocities)
        recorder.wait(lambda: recorder.said(words))
        assert plant.tick == 0 and backend.status().state is State.READY
        assert words in backend.status().details['last_refusal']


def test_stream_that_turns_into_nan_is_stopped_within_the_deceleration_distance():
    with rig() as (plant, backend, recorder):
        stream(backend, recorder, 400, lambda k, q: ([], [0.08, 0.0]))
        begin = plant.position[0]
        backend.submit(recorder.states[-1][0], ['x', 'y'], [], [float('nan')] * 2)
        recorder.wait(lambda: recorder.said('stream ended'))
        quiet(backend, recorder)
        furthest = max(position[0] for position, _ in plant.trace)
        assert furthest - begin < 0.08**2 / (2 * 4.0) + 0.08 * 0.01
        assert abs(plant.velocity[0]) < 1e-3


@pytest.mark.parametrize('both', [False, True])
def test_soft_limit_holds_in_streams(both):
    with rig(start=(0.04, 0.0), following_error_limit=1.0) as (plant, backend, recorder):
        stream(
            backend,
            recorder,
            400,
            lambda k, q: ([0.05, 0.0] if both else [], [0.15, 0.0]),
        )
        assert max(position[0] for position, _ in plant.trace) < 0.05 + 2e-4
        assert plant.position[0] > 0.045
        assert backend.motion.clamped > 0


def test_following_error_latches_a_fault_until_the_reset():
    with rig() as (plant, backend, recorder):
        plant.blocked = True
        backend.submit(0, ['x', 'y'], [0.02, 0.0], [])
        recorder.wait(lambda: recorder.said('following error of x'))
        assert backend.status().state is State.FAULT
        recorder.wait(lambda: backend.motion.at_rest)
        backend.submit(0, ['x'], [0.01], [])
        recorder.wait(lambda: recorder.said('call ~/reset_fault'))
        with pytest.raises(StageError, match='reset_fault'):
            backend.enable(True).result()
        plant.blocked = False
        assert backend.reset_fault().result() == 'ready'
        move(backend, recorder, 0.01, 0.0)
        assert plant.position[0] == pytest.approx(0.01, abs=3e-6)


def test_stop_ends_homing_and_answers_at_once():
    with rig(start=(0.04, 0.0)) as (plant, backend, recorder):
        homing = backend.home()
        recorder.wait(lambda: len(recorder.controls) > 100)
        assert backend.stop() == 'stopping'
        with pytest.raises(StageError, match='homing ended'):
            homing.result()
        quiet(backend, recorder)
        assert plant.position[0] > 0.001 and abs(plant.velocity[0]) < 1e-3


def test_a_set_point_that_comes_after_the_stop_of_its_stream_is_refused():
    with rig() as (plant, backend, recorder):
        stream(backend, recorder, 200, lambda k, q: ([], [0.05, 0.0]))
        backend.stop()
        backend.submit(recorder.states[-1][0], ['x', 'y'], [], [0.05, 0.0])
        # It may come while its tick still waits, or after it.
        recorder.wait(lambda: recorder.said('set-point refused'))
        quiet(backend, recorder)
        assert abs(plant.velocity[0]) < 1e-3
        # A move ends the matter, and the next stream is another one.
        move(backend, recorder, 0.01, 0.0)
        stream(backend, recorder, 100, lambda k, q: ([], [0.05, 0.0]))
        assert plant.velocity[0] == pytest.approx(0.05, rel=0.1)


def send(backend):
    """One set-point of a stream in real time."""
    backend.submit(0, ['x', 'y'], [], [0.02, 0.0])
    time.sleep(0.005)


def send_until(backend, condition):
    deadline = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < deadline, backend.status()
        send(backend)


def test_a_stream_in_real_time_stays_stopped_until_it_pauses():
    with rig(lockstep=False, setpoint_timeout=0.4) as (plant, backend, recorder):
        send_until(backend, lambda: plant.velocity[0] > 0.015)
        backend.stop()
        send_until(backend, lambda: backend.status().state is State.READY)
        stopped = plant.position[0]
        for _ in range(40):
            send(backend)
        assert backend.status().state is State.READY
        assert plant.position[0] == pytest.approx(stopped, abs=1e-4)
        assert 'the stream was stopped' in backend.status().details['last_refusal']
        # A sender that hangs for longer than `setpoint_timeout` has not agreed to go on.
        time.sleep(0.5)
        send(backend)
        assert plant.position[0] == pytest.approx(stopped, abs=1e-4)
        time.sleep(1.1)
        send_until(backend, lambda: plant.velocity[0] > 0.015)


def test_a_move_while_the_stage_brakes_is_watched_as_any_other():
    with rig() as (plant, backend, recorder):
        stream(backend, recorder, 100, lambda k, q: ([], [0.1, 0.0]))
        backend.enable(False).result()
        backend.enable(True).result()
        backend.submit(0, ['x', 'y'], [-0.04, 0.0], [])
        recorder.wait(lambda: plant.velocity[0] < -0.01)
        plant.blocked = True
        recorder.wait(lambda: backend.status().state is State.FAULT)


def test_a_target_that_is_sent_again_after_a_stop_moves_nothing():
    with rig() as (plant, backend, recorder):
        backend.submit(5, ['x', 'y'], [0.04, 0.0], [])
        recorder.wait(lambda: plant.velocity[0] > 0.05)
        backend.stop()
        quiet(backend, recorder)
        rest = plant.position[0]
        # A calibration that follows the temperature has corrected it otherwise by now.
        backend.submit(5, ['x', 'y'], [0.04 + 1e-8, 0.0], [])
        backend.enable(True).result()
        quiet(backend, recorder)
        assert plant.position[0] == pytest.approx(rest, abs=2e-6)


def test_disabled_stage_refuses_moves():
    with rig() as (plant, backend, recorder):
        assert backend.enable(False).result() == 'disabled'
        backend.submit(0, ['x'], [0.01], [])
        recorder.wait(lambda: recorder.said('the stage is disabled'))
        with pytest.raises(StageError, match='disabled'):
            backend.home().result()
        assert plant.tick == 0
        assert backend.enable(True).result() == 'ready'
        move(backend, recorder, 0.001, 0.0)


def test_friction_compensation_is_part_of_the_published_command():
    import numpy as np

    friction = np.array([[20.0, 25.0, 0.001, 2e-6]] * 2)
    with rig(friction=friction) as (_, backend, recorder):
        move(backend, recorder, 0.01, 0.0)
        middle = next(c for c in recorder.controls if c[1][0] > 0.005)
        state = next(s for s in recorder.states if s[0] == middle[0])
        feedback = 40.0 * (middle[1][0] - state[1][0])
        # At speed the bristles carry the Coulomb force: 20 N / 3600 N s/m.
        assert middle[3][0] - feedback == pytest.approx(20.0 / 3600.0, rel=1e-3)


def test_a_stream_refused_before_homing_does_not_go_on_by_itself_after_it():
    options = {'home_required': True, 'setpoint_timeout': 0.4}
    with rig(lockstep=False, **options) as (plant, backend, recorder):
        send(backend)
        recorder.wait(lambda: recorder.said('not homed'))
        send_until(backend, backend.home().done)
        homed = plant.position[0]
        for _ in range(40):
            send(backend)
        assert plant.position[0] == pytest.approx(homed, abs=1e-4)
        assert 'the stream was stopped' in backend.status().details['last_refusal']
        time.sleep(0.5)
        send(backend)
        recorder.wait(lambda: plant.velocity[0] > 0.01)


def test_what_waits_when_a_stop_is_asked_for_is_refused():
    with rig(lockstep=False) as (plant, backend, recorder):
        served = threading.Event()
        backend._inbox.put(served.wait)
        backend.submit(0, ['x', 'y'], [0.03, 0.0], [])
        homing = backend.home()
        backend.stop()
        served.set()
        with pytest.raises(StageError, match='stopped while it waited'):
            homing.result(PATIENCE)
        quiet(backend, recorder)
        assert recorder.said('set-point refused: the stage was stopped while it waited')
        assert plant.position[0] == pytest.approx(0.0, abs=1e-4)
