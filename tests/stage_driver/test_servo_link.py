"""The servo backend whose drive is absent, silent, late or restarted, and its homing then."""

import os
import time
from itertools import pairwise

import pytest

from stage_core import drive_link
from stage_core.errors import StageError
from stage_driver.servo import ServoBackend
from stage_driver.states import State

from .driver_rig import Recorder, SmallPlant
from .servo_rig import lonely, move, quiet, rig


def test_a_drive_has_one_driver():
    with rig() as (plant, backend, recorder):
        with pytest.raises(StageError, match=f'pid {os.getpid()} .*since.* holds the drive 127.0'):
            ServoBackend(backend.config, Recorder())
        move(backend, recorder, 0.001, 0.0)
    with rig() as (_, backend, recorder):
        move(backend, recorder, 0.001, 0.0)


def test_drive_restart_asks_for_homing():
    with rig(home_required=True) as (plant, backend, recorder):
        backend.home().result()
        plant.reset((0.002, 0.0))
        recorder.wait(lambda: recorder.said('restarted'))
        backend.submit(0, ['x'], [0.01], [])
        recorder.wait(lambda: recorder.said('not homed'))
        assert plant.tick == 0


def test_drive_that_dies_while_the_world_is_quiet_is_a_fault_and_may_come_back():
    with rig(lockstep_timeout=2.0) as (plant, backend, recorder):
        move(backend, recorder, 0.001, 0.0)
        plant.muted = True
        recorder.wait(lambda: recorder.said('no encoder datagram'))
        assert backend.status().state is State.FAULT and not backend.status().connected
        plant.muted = False
        recorder.wait(lambda: recorder.said('drive back'))
        assert backend.reset_fault().result() == 'ready'
        move(backend, recorder, 0.002, 0.0)
        assert plant.position[0] == pytest.approx(0.002, abs=3e-6)


@pytest.mark.parametrize(
    'babble', [b'', b'noise', b'SDL1' + bytes(40), b'SDL1\x01\x02' + bytes(34)]
)
def test_garbage_on_the_drive_link_is_dropped(babble):
    not_a_number = drive_link.encode_encoder(10**6, 10**15, (float('nan'), 0.0))
    with rig() as (plant, backend, recorder):
        for data in (babble, not_a_number):
            plant.socket.sendto(data, plant.driver)
        move(backend, recorder, 0.001, 0.0)
        assert plant.position[0] == pytest.approx(0.001, abs=3e-6)


def test_real_time_watchdog_stops_a_stream_and_a_silent_drive_is_a_fault():
    with rig(lockstep=False, link_timeout=0.5) as (plant, backend, recorder):
        backend.submit(0, ['x', 'y'], [], [0.03, 0.0])
        recorder.wait(lambda: recorder.said('stream ended'))
        quiet(backend, recorder)
        assert backend.status().details['watchdog_stops'] == '1'
        # Timeout, ramps and the loop's overshoot; twice as much would already be wrong.
        assert 0.001 < plant.position[0] < 2 * (0.03 * 0.1)
        plant.muted = True
        recorder.wait(lambda: recorder.said('no encoder datagram'))
        assert backend.status().state is State.FAULT
        plant.muted = False
        recorder.wait(lambda: recorder.said('drive back'))
        assert backend.reset_fault().result() == 'ready'


@pytest.mark.parametrize('homing', [False, True])
def test_driver_that_was_late_ends_the_motion_and_goes_on_with_the_newest_tick(homing):
    with rig(lockstep=False, start=(0.04, 0.0), homing_velocity=0.1) as (plant, backend, recorder):
        if homing:
            done = backend.home()
        else:
            backend.submit(0, ['x', 'y'], [0.0, 0.0], [])
        recorder.wait(lambda: plant.velocity[0] < -0.05)
        # A drive waits for nobody: it takes the last force for a while, then brakes by itself.
        plant.patience = 0.0
        until = plant.tick + 150

        def held_up():
            while plant.tick < until:
                time.sleep(0.001)
            plant.patience = 2.0
            recorder.delay = lambda: None

        recorder.delay = held_up
        recorder.wait(lambda: recorder.said('the driver was late by'))
        quiet(backend, recorder)
        assert backend.status().state is State.READY
        # Its own words, no blocked axis; what was measured meanwhile is published all the same.
        assert not recorder.said('following error')
        assert int(backend.status().details['late_ticks']) > 100
        stamps = [stamp for stamp, *_ in recorder.states]
        assert all(later - earlier == 1_000_000 for earlier, later in pairwise(stamps))
        # No force for a tick that was over, and none that pushes the resting stage.
        assert max(later[0] - earlier[0] for earlier, later in pairwise(recorder.controls)) > 100e6
        assert all(abs(velocity[0]) < 0.01 for _, velocity in plant.trace[until + 20 :])
        if homing:
            with pytest.raises(StageError, match='the driver was late'):
                done.result()
        move(backend, recorder, 0.01, 0.0)
        assert plant.position[0] == pytest.approx(0.01, abs=2e-6)


def test_absent_drive_is_named_after_the_declared_time():
    with lonely(drive_timeout=0.3) as (backend, recorder):
        with pytest.raises(StageError, match='no drive at 127.0.0.1:9 within 0.3 s: start it'):
            backend.home().result()
        assert not backend.status().connected
        assert recorder.said('homing waits up to 0.3 s')


@pytest.mark.parametrize('enabled', [False, True])
@pytest.mark.parametrize('lockstep', [False, True])
def test_homing_waits_for_a_drive_that_comes_later(lockstep, enabled):
    plant = SmallPlant(lockstep, (0.01, 0.005))
    try:
        with lonely(plant.port, link_timeout=60.0) as (backend, recorder):
            if enabled:
                assert backend.enable(True).result() == 'ready'
            homing = backend.home()
            recorder.wait(lambda: recorder.said('homing waits'))
            with pytest.raises(StageError, match='homing is under way'):
                backend.home().result()
            plant.start()
            assert homing.result().startswith('homed: x 0.0000')
            assert backend.status().homed and abs(plant.position[0]) < 1e-5
    finally:
        plant.close()


@pytest.mark.parametrize(
    ('end', 'words'),
    [
        (lambda backend: backend.stop(), 'homing ended: stopped by request'),
        (lambda backend: backend.enable(False), 'homing ended: disabled'),
    ],
)
def test_a_homing_that_waits_ends_on_request(end, words):
    with lonely() as (backend, recorder):
        homing = backend.home()
        recorder.wait(lambda: recorder.said('homing waits'))
        end(backend)
        with pytest.raises(StageError, match=words):
            homing.result()
        assert not backend.status().homed


def test_a_stage_disabled_on_purpose_refuses_to_home_at_once():
    for requested in (False, True):
        with lonely(enable_on_start=requested) as (backend, _):
            if requested:
                assert backend.enable(False).result() == 'disabled'
            with pytest.raises(StageError, match='the stage is disabled: call ~/enable'):
                backend.home().result()


def test_a_request_to_disable_outlasts_the_first_contact_and_a_reset():
    plant = SmallPlant()
    try:
        with lonely(plant.port, home_required=False, lockstep_timeout=0.3) as (backend, recorder):
            assert backend.enable(False).result() == 'disabled'
            plant.start()
            recorder.wait(lambda: recorder.said('drive found at tick 0'))
            assert backend.enable(False).result() == 'disabled'
            plant.muted = True
            recorder.wait(lambda: recorder.said('no encoder datagram'))
            plant.muted = False
            recorder.wait(lambda: recorder.said('drive back'))
            assert backend.reset_fault().result() == 'disabled'
            assert backend.enable(True).result() == 'ready'
            move(backend, recorder, 0.001, 0.0)
    finally:
        plant.close()


def test_homing_after_a_loss_waits_until_what_brakes_is_at_rest():
    with rig(lockstep_timeout=0.3, home_required=True) as (plant, backend, recorder):
        backend.home().result()
        plant.muted = True
        recorder.wait(lambda: recorder.said('no encoder datagram'))
        backend.reset_fault().result()
        backend.enable(True).result()
        homing = backend.home()
        recorder.wait(lambda: recorder.said('homing waits'))
        plant.velocity[0] = 0.05
        plant.muted = False
        assert homing.result().startswith('homed')
        assert abs(plant.position[0]) < 1e-5 and abs(plant.velocity[0]) < 1e-3
