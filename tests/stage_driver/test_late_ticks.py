"""What happens when a tick is late: plant, driver or controller, in simulated time.

The backend's own thread runs against a link that owns the time: asking for the next datagram lets
the plant go on. So a delay is as long as it says, however busy the machine is.
"""

import threading
import time
from collections import deque

import numpy as np
import pytest

from contour_ctrl.curves import circle
from contour_ctrl.reference import plan
from contour_ctrl.sequence import ContourRun
from contour_ctrl.tick import Controller, Gains
from stage_core import drive_link
from stage_core.twin_file import TwinFile
from stage_driver.config import ServoConfig
from stage_driver.limits import AxisLimits
from stage_driver.servo import ServoBackend
from stage_driver.states import State

from .driver_rig import Recorder, SmallPlant

RADIUS, FEED = 0.01, 0.05
LIMITS = AxisLimits(-0.03, 0.03, 0.2, 2.0, 4.0)
#: Tick of the contour at which something is late: at full feed.
AT = 500
#: A drive without a force brakes after this many ticks.
PATIENCE = 20


class SimulatedLink:
    """The drive link of a plant whose time passes when the driver asks for its next datagram."""

    def __init__(self):
        self.plant = SmallPlant(lockstep=False, start=(RADIUS, 0.0))
        self.connected = self.lockstep = False
        self.waiting = deque()
        self.before_tick = lambda: None
        self.age = 0
        self.over = threading.Event()

    def advance(self):
        """One tick with the newest force, or with the drive's brake."""
        self.age += 1
        if self.age > PATIENCE:
            self.plant.force = [-2000.0 * v for v in self.plant.velocity]
        self.plant.advance()

    def receive(self, _):
        if self.over.is_set():
            time.sleep(0.001)
        if not self.waiting:
            self.before_tick()
            self.advance()
            self.waiting.append(drive_link.decode(self.plant.packet()))
        return self.waiting.popleft()

    def newer_waits(self):
        return bool(self.waiting)

    def send(self, packet):
        datagram = drive_link.decode(packet)
        if datagram.kind == drive_link.FORCE:
            self.plant.force, self.age = list(datagram.values), 0

    def silence(self):
        return 0.0

    def close(self):
        self.plant.socket.close()


class Bench(Recorder):
    """Driver and contour controller; `within` the tick, or one tick behind over a topic."""

    def __init__(self, within, late, delay):
        super().__init__()
        self.link = SimulatedLink()
        self.link.before_tick = self.before_tick
        self.within, self.late, self.late_by = within, late, delay
        reference = plan(circle(RADIUS), FEED)
        self.course = ContourRun(Controller(reference, Gains(cross_coupling=20.0)), None, 1)
        self.samples = deque()
        self.held_until = 0
        config = ServoConfig(
            ('x', 'y'), (LIMITS, LIMITS), TwinFile.nominal_servo(), home_required=False
        )
        self.backend = ServoBackend(config, self, self.link)

    def before_tick(self):
        """Let the delay begin, and the controller of another process answer."""
        tick = self.link.plant.tick
        if self.course.tick == AT and self.late_by:
            delay, self.late_by = self.late_by, 0
            if self.late == 'controller':
                self.held_until = tick + delay
            for _ in range(delay if self.late != 'controller' else 0):
                self.link.advance()
                if self.late == 'driver':
                    self.link.waiting.append(drive_link.decode(self.link.plant.packet()))
        if not self.within:
            self.answer()
        if self.course.done and self.backend.status().state is not State.MOVING:
            self.link.over.set()

    def on_event(self, level, text):
        super().on_event(level, text)
        stamp = int(self.backend.status().details.get('refused_stamp', 0))
        if 'set-point refused' in text and self.course.awaits(stamp):
            # As the controller's node does when the driver says so.
            self.course.end(text)

    def on_measured(self, stamp, positions):
        if not self.states:
            self.submit(self.course.begin(stamp))
        self.samples.append((stamp, *positions))
        if self.within:
            self.answer()

    def answer(self):
        """What waits is answered in its order, once the controller is there again."""
        while self.samples and self.link.plant.tick >= self.held_until:
            self.submit(self.course.on_state(*self.samples.popleft()))

    def submit(self, point):
        if point is not None:
            self.backend.submit(point.stamp, ('x', 'y'), point.position, point.velocity or ())

    def run(self):
        self.backend.start()
        try:
            assert self.link.over.wait(300.0), (self.course.phase, self.events[-3:])
            return self.backend.status()
        finally:
            self.backend.close()


@pytest.mark.parametrize('delay', [1, 5, 20, 50, 250])
@pytest.mark.parametrize('late', ['plant', 'driver', 'controller'])
@pytest.mark.parametrize('within', [True, False], ids=['composed', 'separate'])
def test_a_late_tick_is_told_and_latches_nothing(within, late, delay):
    bench = Bench(within, late, delay)
    status = bench.run()
    course, details = bench.course, status.details
    assert status.state is State.READY, status.reason
    trace = np.array(bench.link.plant.trace)
    # On the circle, or stopping smoothly along its tangent.
    tangent = 0.5 * bench.course.settings.stop_time * FEED
    assert np.abs(trace[:, 0]).max() < np.hypot(RADIUS, tangent + 1e-3)
    assert np.hypot(*trace[:, 1].T).max() < 1.5 * LIMITS.max_velocity
    # Told in one line: counted on /diagnostics, or the reason why the motion ended.
    counter = {'plant': 'missed_ticks', 'driver': 'late_ticks', 'controller': 'late_setpoints'}
    assert int(details[counter[late]]) >= (0 if (late, delay) == ('controller', 1) else 1)
    ended = [text for _, text in bench.events if 'the stage stops' in text]
    if delay <= 20:
        assert course.success and ended == []
        assert course.results[0].contour.rms < 20e-6
    if late == 'controller':
        assert bool(ended) is (delay > 100)
    elif delay > 20:
        assert any(f'the driver was late by {delay} ms' in text for text in ended)
    if delay == 250:
        assert not course.success, course.message


def test_without_delay_nothing_is_told():
    bench = Bench(True, 'driver', 0)
    details = bench.run().details
    assert bench.course.success
    for counter in ('missed_ticks', 'late_ticks', 'late_setpoints', 'watchdog_stops', 'refused'):
        assert details[counter] == '0'
