"""What can happen to the connection to a tracker: other clients, power, names."""

import math
import socket

import pytest

from stage_twin.emulators.tracker import TrackerInstrument
from stage_twin.emulators.tracker_server import TrackerServer
from tracker_bridge.sources.emscon import EmsconSource
from tracker_bridge.tpi_words import Command, Event, LengthUnit

from ..patience import wait
from .test_sources import Client, push, serving, streaming


def test_units_that_another_client_changes_right_after_the_set_up_are_not_misread():
    with serving() as server, streaming(server) as source:
        source._ready = math.inf
        other = Client(server)
        other.ask(Command.SET_UNITS, LengthUnit.MILLIMETRE, 0, 0, 0, 0)
        push(server, range(3))
        server.flush()
        wait(lambda: source.samples or source.counters.get('reconnects'))
        assert not source.samples
        wait(lambda: source.connected)
        push(server, range(3, 6))
        server.flush()
        wait(lambda: len(source.samples) == 3)
        assert source.samples[-1].point == pytest.approx((5e-3, -0.5, 0.25))
        # What follows the second set-up at once is its own echo: no ring of set-ups.
        source._ready = math.inf
        source._take_event(Event.UNITS_CHANGED)
        other.close()


def test_units_that_another_client_changes_during_the_initialisation_are_not_misread():
    commands = []

    class Instrument(TrackerInstrument):
        def _execute(self, number, command):
            commands.append(command.command)
            super()._execute(number, command)

    server = TrackerServer(Instrument())
    try:
        with streaming(server):
            pass
    finally:
        server.close()
    assert Command.SET_UNITS in commands[commands.index(Command.INITIALIZE) :]


def test_a_tracker_without_power_is_noticed():
    with serving() as server, streaming(server) as source:
        options = [socket.TCP_KEEPIDLE, socket.TCP_KEEPINTVL, socket.TCP_KEEPCNT]
        idle, step, count = (source._socket.getsockopt(socket.IPPROTO_TCP, o) for o in options)
        assert source._socket.getsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE)
        assert idle + step * count <= 10


@pytest.mark.parametrize('host', ['tracker..local', 70 * 'x'])
def test_a_host_that_can_be_no_name_is_said(host):
    source = EmsconSource(lambda _: None, host, 700)
    source.start()
    try:
        wait(lambda: source.trouble or not source.is_alive())
        assert host in source.trouble and source.is_alive()
    finally:
        source.stop()
