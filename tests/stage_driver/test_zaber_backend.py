"""The Zaber backend against the emulated chain on a pseudo-terminal, with faults on the wire."""

import time
from contextlib import contextmanager

import pytest

from stage_core.errors import StageError
from stage_driver.states import State
from stage_driver.zaber_units import ZaberUnits
from stage_twin.emulators.zaber_faults import KINDS

from ..patience import wait
from .zaber_rig import IMPATIENT, STEP, move, position, rig


def test_native_units():
    units = ZaberUnits(STEP)
    assert units.steps(0.005) == 104987
    assert units.speed(0.001) == 34402
    assert units.acceleration(1.0) == 3440
    assert units.metres(units.steps(0.0123)) == pytest.approx(0.0123, abs=STEP / 2)


def test_home_move_and_publish(tmp_path):
    with rig(tmp_path) as (server, backend, recorder):
        backend.submit(0, ['x'], [0.01], [])
        recorder.wait(lambda: recorder.said('not homed'))
        assert not backend.status().homed
        assert backend.home().result() == 'homed: x, y'
        move(backend, recorder, 0.01, 0.004)
        assert position(server) == pytest.approx([0.01, 0.004], abs=STEP)
        recorder.wait(lambda: recorder.states[-1][1] == pytest.approx((0.01, 0.004), abs=STEP))
        assert recorder.controls[-1][1] == (0.01, 0.004) and recorder.controls[-1][4] == ()
        assert recorder.temperatures[0][1] == ('controller_x', 'controller_y')
        assert server.chain.devices[0].values['knob.enable'] == 0
        assert server.chain.axes[0].values['motion.decelonly'] == 3440
        assert backend.status().state is State.READY
    assert server.chain.devices[0].values['knob.enable'] == 1
    assert server.chain.axes[0].values['motion.decelonly'] == 205


def test_velocity_stream_is_bounded_and_its_end_is_watched(tmp_path):
    with rig(tmp_path) as (server, backend, recorder):
        backend.home().result()
        begin = position(server)[0]
        for _ in range(30):
            backend.submit(0, ['x', 'y'], [], [0.01, 0.0])
            time.sleep(0.01)
        recorder.wait(lambda: recorder.said('stream ended'))
        wait(lambda: backend.status().state is State.READY)
        end = position(server)[0]
        # 0.3 s of stream, the timeout, and the look-ahead: never more, whatever the load.
        assert begin + 0.001 < end
        assert position(server)[1] == pytest.approx(0.0, abs=STEP)
        assert backend.status().details['watchdog_stops'] == '1'


def test_a_stream_that_was_stopped_stays_stopped(tmp_path):
    with rig(tmp_path) as (server, backend, recorder):
        backend.home().result()
        for k in range(60):
            backend.submit(0, ['x', 'y'], [], [0.01, 0.0])
            time.sleep(0.01)
            if k == 29:
                backend.stop()
                stopped = position(server)[0]
        assert recorder.said('the stream was stopped')
        wait(lambda: backend.status().state is State.READY)
        # 0.3 s more of the stream would be 3 mm.
        assert position(server)[0] < stopped + 0.001


def test_dead_host_leaves_the_axis_at_its_bound(tmp_path):
    """Stop the backend's thread without any farewell: the streamed move ends by itself."""
    with rig(tmp_path) as (server, backend, recorder):
        backend.home().result()
        for _ in range(10):
            backend.submit(0, ['x', 'y'], [], [0.02, 0.0])
            time.sleep(0.01)
        backend._ended.set()
        backend._thread.join(timeout=5)
        wait(lambda: not server.chain.axes[0].busy)
        assert server.chain.axes[0].position > 0
        assert server.chain.axes[0].position * STEP < 0.02


@pytest.mark.parametrize('kind', KINDS)
def test_moves_survive_one_broken_reply_without_moving_twice(tmp_path, kind):
    with rig(tmp_path, reply_timeout=0.5) as (server, backend, recorder):
        backend.home().result()
        server.chain.faults.delay = 0.8
        sent = []
        original = server.chain.axes[0].move
        server.chain.axes[0].move = lambda *a: (sent.append(a), original(*a))
        with server._lock:
            server.chain.faults.inject(kind, 3)
        move(backend, recorder, 0.003, 0.002)
        assert position(server) == pytest.approx([0.003, 0.002], abs=STEP)
        assert len(sent) == 1
        wait(lambda: backend.status().state is State.READY)
        assert server.chain.faults.applied == 3
        first = backend.status().details
        assert not recorder.said('fault'), (first, recorder.events)


def test_move_command_that_never_reached_the_device_is_sent_once_more(tmp_path):
    with rig(tmp_path, **IMPATIENT) as (server, backend, recorder):
        backend.home().result()
        device = server.chain.devices[0]
        answer, lost = device.answer, []

        def lossy(request):
            if request.words[:2] == ('move', 'abs') and not lost:
                lost.append(request)
                return []
            return answer(request)

        device.answer = lossy
        move(backend, recorder, 0.003, 0.002)
        assert lost and position(server) == pytest.approx([0.003, 0.002], abs=STEP)


def test_cable_pulled_and_put_back_reconnects_without_moving(tmp_path):
    with rig(tmp_path, **IMPATIENT) as (server, backend, recorder):
        backend.home().result()
        move(backend, recorder, 0.002, 0.002)
        server.unplug()
        recorder.wait(lambda: recorder.said('fault'))
        assert backend.status().state is State.FAULT and not backend.status().connected
        with pytest.raises(StageError, match='check power and cable'):
            backend.reset_fault().result()
        before = position(server)
        server.plug()
        recorder.wait(lambda: recorder.said('is back'))
        assert recorder.said('the position is known')
        backend.submit(0, ['x'], [0.004], [])
        recorder.wait(lambda: recorder.said('~/reset_fault, then'))
        assert position(server) == before
        assert backend.reset_fault().result() == 'ready'
        move(backend, recorder, 0.003, 0.002)
        assert position(server)[0] == pytest.approx(0.003, abs=STEP)


def test_cable_pulled_in_a_move_and_put_back_leaves_the_axis_at_rest(tmp_path):
    # A busy machine holds up both ends of the wire, which live in this process.
    with rig(tmp_path, link_timeout=2.0, reply_timeout=0.5) as (server, backend, recorder):
        backend.home().result()
        backend.submit(0, ['x'], [0.045], [])
        wait(lambda: position(server)[0] > 0.001)
        server.unplug()
        recorder.wait(lambda: recorder.said('fault'))
        # The protocol knows no dead host: the axis ends at its target, no further.
        server.plug()
        recorder.wait(lambda: recorder.said('is back'))
        wait(lambda: not server.chain.axes[0].busy)
        rest = position(server)
        assert rest[0] <= 0.045 + STEP
        backend.submit(0, ['x'], [0.001], [])
        recorder.wait(lambda: recorder.said('~/reset_fault, then'))
        assert position(server) == rest
        assert backend.status().state is State.FAULT
        assert backend.reset_fault().result() == 'ready'
        assert position(server) == rest
        move(backend, recorder, 0.003, 0.0)
        assert position(server)[0] == pytest.approx(0.003, abs=STEP)


#: Answers in a row of which every one comes too late. A busy machine holds up both ends of the
#: wire, which live in this process: that is no silence as long as it is shorter than a second.
LATE = 16


def answer_late(server):
    server.chain.faults.delay = 0.8
    with server._lock:
        server.chain.faults.inject('delay', LATE)


def test_answers_that_come_late_end_the_stream_and_latch_nothing(tmp_path):
    """What a busy computer does to both ends of the wire: every answer comes, all of them late."""
    with rig(tmp_path, **IMPATIENT, setpoint_timeout=60.0) as (server, backend, recorder):
        backend.home().result()
        move(backend, recorder, 0.02, 0.02)
        backend.submit(0, ['x', 'y'], [], [0.005, 0.0])
        wait(lambda: position(server)[0] > 0.0201)
        answer_late(server)
        recorder.wait(lambda: recorder.said('answers later than 0.5 s: lower the load'))
        wait(lambda: server.chain.faults.applied == LATE)
        wait(lambda: backend.status().state is State.READY)
        status = backend.status()
        assert status.connected and status.details['watchdog_stops'] == '1'
        assert int(status.details['line_late']) > 0 and status.details['reconnections'] == '0'
        assert not recorder.said('fault')
        move(backend, recorder, 0.003, 0.002)
        assert position(server) == pytest.approx([0.003, 0.002], abs=STEP)


def test_a_stage_that_was_late_and_then_is_dead_is_a_fault(tmp_path):
    with rig(tmp_path, **IMPATIENT) as (server, backend, recorder):
        backend.home().result()
        answer_late(server)
        recorder.wait(lambda: recorder.said('answers later than 0.5 s'))
        with server._lock:
            server.chain.faults.inject('drop', 10000)
        recorder.wait(lambda: recorder.said('check power and cable'))
        wait(lambda: backend.status().state is State.FAULT)


@contextmanager
def late(link, words):
    """Answers to requests that begin with these words come, but always after the patience."""
    ask_all = link.ask_all

    def impatient(queries):
        replies = ask_all(queries)
        behind = [query.words.startswith(words) for query in queries]
        link.counts['late'] += sum(behind)
        return [None if gone else reply for gone, reply in zip(behind, replies, strict=True)]

    link.ask_all = impatient
    yield
    link.ask_all = ask_all


def stall(server, recorder):
    """The first axis stalls, and the driver says so."""
    with server._lock:
        server.chain.axes[0].raise_flag('FS')
    recorder.wait(lambda: recorder.said('stalled and stopped'))


def test_a_stall_whose_question_was_answered_late_is_asked_for_again(tmp_path):
    with rig(tmp_path) as (server, backend, recorder):
        backend.home().result()
        with late(backend._stage.link, 'warnings'):
            with server._lock:
                server.chain.axes[0].raise_flag('FS')
            recorder.wait(lambda: recorder.said('answers later than 5.0 s: lower the load'))
            assert backend.status().state is State.READY
        recorder.wait(lambda: recorder.said('stalled and stopped'))
        assert backend.status().state is State.FAULT and 'FS' in backend.status().warnings


def test_a_reset_that_is_answered_late_blames_no_cable_and_can_be_repeated(tmp_path):
    with rig(tmp_path) as (server, backend, recorder):
        backend.home().result()
        stall(server, recorder)
        with late(backend._stage.link, 'warnings'):
            with pytest.raises(StageError, match='lower the load of this computer$'):
                backend.reset_fault().result()
            assert backend.status().state is State.FAULT and backend.status().connected
        assert backend.reset_fault().result() == 'ready'
        move(backend, recorder, 0.003, 0.002)
        assert position(server) == pytest.approx([0.003, 0.002], abs=STEP)


def test_stop_brakes_at_its_deceleration_and_not_past_the_target(tmp_path):
    with rig(tmp_path) as (server, backend, recorder):
        backend.home().result()
        backend.submit(0, ['x'], [0.04], [])
        axis = server.chain.axes[0]
        wait(lambda: server.chain.plant.velocity_steps(0) * STEP > 0.08)
        backend.stop()
        wait(lambda: not axis.busy)
        # From 0.1 m/s at 1 m/s^2; with the device's own 0.06 m/s^2 it would be 83 mm.
        assert position(server)[0] < 0.04 + STEP
        wait(lambda: backend.status().state is State.READY)


def test_stop_ends_homing(tmp_path):
    with rig(tmp_path, start=(200_000, 2000)) as (server, backend, recorder):
        homing = backend.home()
        wait(lambda: server.chain.axes[0].busy)
        backend.stop()
        with pytest.raises(StageError, match='homing ended: stopped by request'):
            homing.result()
        wait(lambda: not server.chain.axes[0].busy)
        assert not backend.status().homed
        backend.submit(0, ['x'], [0.01], [])
        recorder.wait(lambda: recorder.said('not homed'))
        assert backend.home().result() == 'homed: x, y'


def test_power_cycle_asks_for_homing(tmp_path):
    with rig(tmp_path) as (server, backend, recorder):
        backend.home().result()
        move(backend, recorder, 0.002, 0.002)
        server.power_cycle()
        recorder.wait(lambda: recorder.said('lost its position'))
        backend.submit(0, ['x'], [0.004], [])
        recorder.wait(lambda: recorder.said('not homed'))
        assert 'WR' in backend.status().warnings
        assert backend.home().result() == 'homed: x, y'
        assert position(server) == pytest.approx([0.0, 0.0], abs=STEP)


def test_stall_is_a_latched_fault_in_plain_words(tmp_path):
    with rig(tmp_path) as (server, backend, recorder):
        backend.home().result()
        stall(server, recorder)
        assert backend.status().state is State.FAULT
        assert 'FS' in backend.status().warnings
        assert backend.reset_fault().result() == 'ready'
        with server._lock:
            server.chain.axes[1].raise_flag('FF')
        recorder.wait(lambda: recorder.said('critical system error'))
        with pytest.raises(StageError, match='the fault stays: FF'):
            backend.reset_fault().result()


def test_stop_ends_a_move_and_disabling_refuses_the_next(tmp_path):
    with rig(tmp_path) as (server, backend, recorder):
        backend.home().result()
        backend.submit(0, ['x', 'y'], [0.05, 0.05], [])
        wait(lambda: server.chain.axes[0].busy)
        assert backend.stop() in ('stopping', 'at rest')
        wait(lambda: backend.status().state is State.READY)
        assert position(server)[0] < 0.049
        assert backend.enable(False).result() == 'disabled'
        backend.submit(0, ['x'], [0.001], [])
        recorder.wait(lambda: recorder.said('the stage is disabled'))
        assert backend.enable(True).result() == 'ready'
        move(backend, recorder, 0.001, 0.001)


def test_bad_setpoints_name_axis_value_and_limit(tmp_path):
    with rig(tmp_path) as (server, backend, recorder):
        backend.home().result()
        before = position(server)
        backend.submit(0, ['y'], [0.2], [])
        assert recorder.said('position of y 0.200000 m is outside its limits 0.000000 ... 0.05')
        backend.submit(0, ['x'], [float('nan')], [])
        assert recorder.said('position of x is nan')
        time.sleep(0.1)
        assert position(server) == before
