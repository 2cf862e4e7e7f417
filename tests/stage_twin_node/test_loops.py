"""The plant's two clocks against a driver of a few lines on real sockets."""

import contextlib
import math
import socket
import threading
import time

import pytest

from stage_core import drive_link
from stage_core.errors import StageError
from stage_core.twin_file import TwinFile
from stage_twin.emulators.drive import DriveSocket
from stage_twin.loops import LOCKSTEP_START_NS, LockstepLoop, RealTimeLoop
from stage_twin.machine import ServoMachine

from ..patience import PATIENCE, wait
from ..points import PointRecorder


class Driver:
    """A driver that answers each encoder with a force of its choice."""

    def __init__(self, port):
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.connect(('127.0.0.1', port))
        self.socket.settimeout(5.0)
        self.socket.send(drive_link.encode_hello())

    def receive(self):
        return drive_link.decode(self.socket.recv(2048))

    def fresh(self):
        while (datagram := self.receive()).flags & drive_link.REPEATED:
            pass
        return datagram

    def send(self, tick, *forces):
        self.socket.send(drive_link.encode_force(tick, 0, forces))

    def close(self):
        self.socket.close()


@pytest.fixture(scope='module')
def machine():
    return ServoMachine(TwinFile.nominal_servo(), seed=3)


MODEL = """<mujoco><option timestep="0.001" gravity="0 0 0"/><worldbody>
<body><joint name="x" type="slide" axis="1 0 0"/>
<inertial pos="0 0 0" mass="18" diaginertia="1 1 1"/></body>
<body><joint name="y" type="slide" axis="0 1 0"/>
<inertial pos="0 0 0" mass="8" diaginertia="1 1 1"/></body>
</worldbody><actuator><motor joint="x"/><motor joint="y"/></actuator></mujoco>"""


@contextlib.contextmanager
def running(loop):
    loop.start()
    try:
        yield loop
    finally:
        loop.stop()
        assert loop.failure is None


def lockstep(machine, **options):
    machine.reset()
    clock = []
    loop = LockstepLoop(machine, DriveSocket(2, 0), PointRecorder(), clock.append, **options)
    loop.clock = clock
    return loop


def push_constant_force(loop, ticks):
    driver = Driver(loop.drive.port)
    seen = [driver.receive()]
    for tick in range(ticks):
        driver.send(tick, 20.0, -5.0)
        seen.append(driver.fresh())
    driver.close()
    return seen


def test_lockstep_is_the_plant_and_deterministic(machine):
    runs = []
    for _ in range(2):
        with running(lockstep(machine)) as loop:
            seen = push_constant_force(loop, 300)
        runs.append((seen[1:], loop.tracker.points))
    assert runs[0] == runs[1]
    seen, points = runs[0]
    assert [datagram.tick for datagram in seen] == list(range(1, 301))
    assert [d.stamp for d in seen] == [LOCKSTEP_START_NS + k * 1_000_000 for k in range(1, 301)]
    assert seen[-1].temperatures == (20.0, 20.0, 20.0, 20.0)
    # m a + c v = F from rest: x = F/c (t - m/c (1 - exp(-c t/m)))
    t, mass, viscous = 0.3, 18.0, 40.0
    exact = 20.0 / viscous * (t - mass / viscous * (1.0 - math.exp(-viscous * t / mass)))
    assert abs(seen[-1].values[0] - exact) < 1.0e-6
    assert [stamp for stamp, _ in points] == [
        LOCKSTEP_START_NS + k * 10_000_000 for k in range(31)
    ]
    assert abs(points[-1][1][0] - exact) < 6.0e-6


def test_lockstep_points_are_written_before_the_encoder_that_follows(machine):
    loop = lockstep(machine)
    sent = []
    send = loop.drive.send

    def watched(tick, stamp, positions, temperatures, flags=0):
        sent.append((stamp, loop.tracker.flushed))
        send(tick, stamp, positions, temperatures, flags)

    loop.drive.send = watched
    with running(loop):
        push_constant_force(loop, 25)
    for stamp, flushed in sent:
        assert flushed == (stamp - LOCKSTEP_START_NS) // 10_000_000 + 1


def test_lockstep_time_stands_still_and_a_new_driver_joins(machine):
    with running(lockstep(machine)) as loop:
        last = push_constant_force(loop, 5)[-1]
        stamps = len(loop.clock)
        driver = Driver(loop.drive.port)
        joined = driver.receive()
        repeated = driver.receive()
        driver.close()
        for datagram in (joined, repeated):
            assert (datagram.tick, datagram.stamp) == (last.tick, last.stamp)
        assert repeated.flags & drive_link.REPEATED
        assert set(loop.clock[stamps:]) == {last.stamp}


def test_lockstep_stale_and_foreign_forces_change_nothing(machine):
    with running(lockstep(machine)) as loop:
        push_constant_force(loop, 3)
        driver = Driver(loop.drive.port)
        driver.receive()
        driver.send(1, 1.0, 1.0)
        driver.send(3, float('nan'), 1.0)
        driver.send(3, 1.0)
        driver.socket.send(b'garbage')
        stranger = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        stranger.sendto(drive_link.encode_force(3, 0, (9.0, 9.0)), ('127.0.0.1', loop.drive.port))
        stranger.close()
        assert driver.receive().tick == 3
        driver.send(3, 0.0, 0.0)
        assert driver.fresh().tick == 4
        driver.close()
        assert loop.drive.refused == 4


def test_lockstep_brakes_a_moving_stage_when_its_driver_dies(machine):
    with running(lockstep(machine, watchdog=0.2)) as loop:
        push_constant_force(loop, 200)
        assert machine.moving
        wait(lambda: machine.at_rest)
        # 0.2 m/s decays with 20 ms to 10 µm/s in some 0.2 s.
        assert 50 < loop.braked < 500


def test_reset_starts_ticks_anew_and_keeps_time_going(machine):
    with running(lockstep(machine)) as loop:
        push_constant_force(loop, 50)
        driver = Driver(loop.drive.port)
        driver.receive()
        assert loop.reset()
        datagram = driver.receive()
        while not datagram.flags & drive_link.RESET:
            datagram = driver.receive()
        driver.close()
        assert (datagram.tick, datagram.stamp) == (0, LOCKSTEP_START_NS + 50_000_000)
        assert datagram.values == (0.0, 0.0)


def test_real_time_follows_forces_and_brakes_in_silence(machine):
    machine.reset()
    loop = RealTimeLoop(machine, DriveSocket(2, 0), PointRecorder(), watchdog=0.02)
    with running(loop):
        driver = Driver(loop.drive.port)
        stamps = []
        begin = time.time_ns()
        for _ in range(200):
            datagram = driver.receive()
            stamps.append(datagram.stamp)
            driver.send(datagram.tick, 20.0, 0.0)
        assert abs(stamps[0] - begin) < 5_000_000_000
        steps = [b - a for a, b in zip(stamps, stamps[1:], strict=False)]
        assert all(step >= 1_000_000 for step in steps)
        driver.close()
        wait(lambda: loop.braking and machine.at_rest)
        assert machine.positions()[0] > 1e-4
    stamps = [stamp for stamp, _ in loop.tracker.points]
    assert stamps == sorted(stamps)


def late_driver(loop, at, wait):
    """Answer 200 ticks, one of them late; stamps of the encoders and whether the machine was."""
    driver = Driver(loop.drive.port)
    stamps = []
    for number in range(200):
        datagram = driver.receive()
        stamps.append(datagram.stamp)
        if number == at:
            paused = loop.pacer.pauses
            time.sleep(wait)
        driver.send(datagram.tick, 0.0, 0.0)
    driver.close()
    return [b - a for a, b in zip(stamps[at:], stamps[at + 1 :], strict=False)], paused


def test_real_time_waits_for_a_late_force_and_catches_up(machine):
    # On a busy machine the other ticks may come late as well: one calm attempt is enough.
    for _ in range(10):
        machine.reset()
        with running(RealTimeLoop(machine, DriveSocket(2, 0), PointRecorder())) as loop:
            steps, paused = late_driver(loop, 50, 0.02)
            calm = loop.pacer.pauses == paused
        assert loop.held_ticks >= 1 and loop.pacer.worst > 0.018
        if calm:
            assert steps == [1_000_000] * 149
            return
    pytest.fail('the machine was never calm: ten times a processor was gone for 30 ms')


def test_real_time_that_cannot_be_caught_up_is_lost(machine):
    machine.reset()
    with running(RealTimeLoop(machine, DriveSocket(2, 0), PointRecorder())) as loop:
        steps, paused = late_driver(loop, 50, 0.15)
        assert loop.pacer.pauses > paused
    assert sum(steps) - 149 * 1_000_000 >= 90_000_000
    assert all(step >= 1_000_000 for step in steps)


def test_a_taken_port_is_one_clear_error():
    first = DriveSocket(2, 0)
    with pytest.raises(StageError, match=f'{first.port}.*drive_port'):
        DriveSocket(2, first.port)
    first.close()


def test_no_thread_is_left():
    names = {thread.name for thread in threading.enumerate()}
    assert 'plant' not in names


def test_a_plant_that_fails_is_told_and_not_silent(machine):
    loop = lockstep(machine)

    def broken(_):
        raise RuntimeError('broken clock')

    loop._publish_clock = broken
    loop.start()
    loop.join(PATIENCE)
    level, message, _ = loop.status()
    loop.stop()
    assert level == 2 and 'broken clock' in message and 'start stage_twin again' in message


def test_a_model_of_mujoco_moves_behind_the_same_wire(tmp_path):
    pytest.importorskip('mujoco', reason='the optional package mujoco is not installed')
    (tmp_path / 'stage.xml').write_text(MODEL)
    machine = ServoMachine(TwinFile.nominal_servo(), model=str(tmp_path / 'stage.xml'))
    with running(lockstep(machine)) as loop:
        seen = push_constant_force(loop, 100)
    # F/m over 0.1 s, in whole steps of a millisecond.
    expected = (0.5 * 20.0 / 18.0 * 0.01, -0.5 * 5.0 / 8.0 * 0.01)
    assert seen[-1].values == pytest.approx(expected, rel=0.02)
    assert seen[-1].stamp == LOCKSTEP_START_NS + 100 * 10**6
    assert len(loop.tracker.points) == 11
    machine.reset()
    assert machine.positions() == (0.0, 0.0)
    assert machine.at_rest
