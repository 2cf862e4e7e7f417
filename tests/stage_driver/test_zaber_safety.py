"""The Zaber backend lets nothing move that was stopped, lost or asked to go the other way."""

import pytest

from stage_core.errors import StageError
from stage_driver.limits import AxisLimits
from stage_driver.states import State
from stage_twin.emulators.zaber_pty import ZaberPty

from ..patience import wait
from . import zaber_rig
from .zaber_rig import IMPATIENT, STEP, position, rig

BOTH = ['x', 'y']
#: For a stream that is not to end by itself.
ENDLESS = {'setpoint_timeout': 600.0}


def test_a_silent_device_is_a_fault_that_stops_the_other_one(tmp_path, monkeypatch):
    # So slow that it is under way for 20 s.
    monkeypatch.setattr(zaber_rig, 'LIMITS', AxisLimits(0.0, 0.05, 0.002, 1.0, 1.0))
    with rig(tmp_path, **IMPATIENT) as (server, backend, recorder):
        backend.home().result()
        axis = server.chain.axes[0]
        backend.submit(0, BOTH, [0.045, 0.0], [])
        wait(lambda: position(server)[0] > 1e-4)
        server.chain.devices[1].answer = lambda request: []
        recorder.wait(lambda: recorder.said('fault'))
        wait(lambda: not axis.busy)
        assert position(server)[0] < 0.04
        # A stop that did not arrive is sent again while contact is sought.
        with server._lock:
            axis.move(900_000, 50_000)
        wait(lambda: not axis.busy)
        assert position(server)[0] < 0.04
        with pytest.raises(StageError, match='may still move, use the emergency stop'):
            backend.stop()


def test_a_stopped_move_whose_reply_was_lost_is_not_sent_again(tmp_path):
    with rig(tmp_path, reply_timeout=0.5) as (server, backend, recorder):
        backend.home().result()
        device, moves = server.chain.devices[0], []
        answer = device.answer

        def lossy(request):
            lines = answer(request)
            if request.words[0] != 'move':
                return lines
            moves.append(request)
            return []

        device.answer = lossy
        backend.submit(0, BOTH, [0.045, 0.0], [])
        wait(lambda: moves)
        assert backend.stop() == 'stopping'
        wait(lambda: backend.status().state is not State.MOVING)
        assert len(moves) == 1 and backend.status().state is State.READY
        assert position(server)[0] < 0.04


@pytest.mark.parametrize('braking', [True, False])
def test_after_a_stop_a_setpoint_for_one_axis_leaves_the_other_one(tmp_path, braking):
    with rig(tmp_path) as (server, backend, recorder):
        backend.home().result()
        backend.submit(0, BOTH, [0.045, 0.045], [])
        wait(lambda: position(server)[1] > 0.02)
        backend.stop()
        if not braking:
            wait(lambda: backend.status().state is State.READY)
            seen = len(recorder.controls)
            recorder.wait(lambda: len(recorder.controls) > seen + 1)
            assert recorder.controls[-1][1] == pytest.approx(position(server), abs=STEP)
        backend.submit(0, ['x'], [0.001], [])
        wait(lambda: position(server)[0] == pytest.approx(0.001, abs=STEP))
        wait(lambda: backend.status().state is State.READY)
        passed = [positions[1] for _, positions, _ in recorder.states]
        first = next(k for k, place in enumerate(passed) if place > 0.01)
        assert passed[first:] == sorted(passed[first:])


def test_homing_is_refused_while_a_stream_is_followed(tmp_path):
    with rig(tmp_path, **ENDLESS) as (server, backend, recorder):
        backend.home().result()
        backend.submit(0, BOTH, [], [0.001, 0.0])
        with pytest.raises(StageError, match='a stream is being followed: end it first'):
            backend.home().result()


def test_beyond_a_limit_a_velocity_outwards_moves_nothing(tmp_path, monkeypatch):
    # Home is outside.
    monkeypatch.setattr(zaber_rig, 'LIMITS', AxisLimits(0.01, 0.05, 0.1, 1.0, 1.0))
    with rig(tmp_path, **ENDLESS) as (server, backend, recorder):
        backend.home().result()
        backend.submit(0, BOTH, [], [-0.02, 0.0])
        recorder.wait(lambda: recorder.controls[-1][2] == (-0.02, 0.0))
        seen = len(recorder.states)
        recorder.wait(lambda: len(recorder.states) > seen + 5)
        assert position(server) == [0.0, 0.0]
        backend.submit(0, BOTH, [], [0.02, 0.0])
        wait(lambda: position(server)[0] > 0.001)


def test_an_axis_that_its_last_driver_left_on_a_move_is_stopped(tmp_path, monkeypatch):
    # So slow that it is under way for 20 s.
    monkeypatch.setattr(
        zaber_rig, 'ZaberPty', lambda chain, link: ZaberPty(_on_a_move(chain), link=link)
    )
    with rig(tmp_path) as (server, _, recorder):
        wait(lambda: not server.chain.axes[0].busy)
        assert position(server)[0] < 0.02


def _on_a_move(chain):
    chain.axes[0].move(900_000, 50_000)
    return chain
