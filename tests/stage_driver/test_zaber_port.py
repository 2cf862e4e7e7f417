"""The Zaber backend and its port: absent, taken, silent, or with garbage on it."""

import os
import socket
import threading

import pytest

from stage_core.errors import StageError
from stage_driver.config import ZaberConfig
from stage_driver.limits import AxisLimits
from stage_driver.zaber import ZaberBackend
from stage_driver.zaber_link import ZaberLink
from stage_driver.zaber_stage import ZaberStage
from stage_twin.emulators.zaber_pty import ZaberPty

from .driver_rig import Recorder
from .zaber_rig import LIMITS, STEP, chain, rig


def test_a_port_that_is_not_there_yet_is_waited_for(tmp_path):
    link, recorder = tmp_path / 'later', Recorder()
    config = ZaberConfig(('x', 'y'), (LIMITS, LIMITS), str(link))
    backend = ZaberBackend(config, recorder)
    backend.start()
    try:
        assert recorder.said(f'waiting: cannot open port {link}: No such file')
        assert (
            not backend.status().connected and 'No such file' in backend.status().details['waits']
        )
        homing = backend.home()
        recorder.wait(lambda: recorder.said(f'homing waits up to 60 s for the port {link}'))
        with ZaberPty(chain(0, 0), link=link):
            assert homing.result() == 'homed: x, y'
            assert backend.status().connected and 'waits' not in backend.status().details
    finally:
        backend.close()


def test_homing_waits_for_a_port_only_so_long(tmp_path):
    link = str(tmp_path / 'never')
    config = ZaberConfig(('x',), (LIMITS,), link, (1,), (1,), (STEP,), drive_timeout=0.1)
    backend = ZaberBackend(config, Recorder())
    backend.start()
    try:
        with pytest.raises(StageError, match=f'no port {link} within 0.1 s'):
            backend.home().result()
    finally:
        backend.close()


def test_a_port_has_one_driver(tmp_path):
    with rig(tmp_path) as (server, backend, recorder):
        for port in (backend.config.port, server.port):
            second = ZaberConfig(('x', 'y'), (LIMITS, LIMITS), port)
            with pytest.raises(
                StageError, match=rf'pid {os.getpid()} \(since .*\) holds the port'
            ):
                ZaberBackend(second, Recorder()).start()
        assert backend.home().result()


def test_a_port_behind_a_network_has_one_driver():
    with socket.create_server(('127.0.0.1', 0)) as server:
        number = server.getsockname()[1]
        first = ZaberLink(f'socket://127.0.0.1:{number}')
        with pytest.raises(StageError, match=rf'holds the port socket://127.0.0.1:{number}'):
            ZaberLink(f'socket://localhost:{number}')
        first.close()


@pytest.mark.parametrize(
    ('babble', 'words'), [(b'', 'no answer from device 1'), (b'\x91\x04~~\r\n', 'answers garbage')]
)
def test_silence_and_garbage_are_told_apart(babble, words):
    import pty
    import tty

    master, slave = pty.openpty()
    tty.setraw(master)
    tty.setraw(slave)
    ended = threading.Event()

    def serve():
        while not ended.is_set():
            os.set_blocking(master, False)
            try:
                if os.read(master, 100) and babble:
                    os.write(master, babble)
            except BlockingIOError:
                ended.wait(0.005)

    thread = threading.Thread(target=serve)
    thread.start()
    try:
        config = ZaberConfig(
            ('x',), (LIMITS,), os.ttyname(slave), (1,), (1,), (STEP,), reply_timeout=0.05
        )
        with pytest.raises(StageError, match=words):
            ZaberStage(config)
    finally:
        ended.set()
        thread.join()
        os.close(master)
        os.close(slave)


def test_limits_outside_the_travel_are_an_error(tmp_path):
    with ZaberPty(chain(0, 0)) as server:
        far = AxisLimits(0.5, 0.6, 0.1, 1.0, 1.0)
        config = ZaberConfig(('x',), (far,), server.port, (1,), (1,), (STEP,))
        with pytest.raises(StageError, match='outside the travel'):
            ZaberStage(config)
