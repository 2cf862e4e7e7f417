"""A small independent servo plant behind the drive link, and a recording listener."""

import math
import socket
import threading
import time

from stage_core import drive_link

from ..patience import PATIENCE

PERIOD = 0.001
START = 1_000_000_000
#: Wait for a force that is late [s].
FORCE_PATIENCE = 2.0


class SmallPlant(threading.Thread):
    """Serves the drive link; in lockstep it waits for each force, else it runs in real time."""

    def __init__(self, lockstep=True, start=(0.0, 0.0)):
        super().__init__(daemon=True)
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(('127.0.0.1', 0))
        self.socket.settimeout(0.05)
        self.port = self.socket.getsockname()[1]
        self.lockstep = lockstep
        self.mass, self.viscous = (18.0, 8.0), (40.0, 30.0)
        self.position, self.velocity = list(start), [0.0, 0.0]
        self.force = [0.0, 0.0]
        self.tick = 0
        self.driver = None
        self.muted = False
        self.blocked = False
        self.patience = FORCE_PATIENCE
        self.last_force_tick = -1
        self.trace = []
        self.ended = threading.Event()

    def packet(self, flags=0):
        if self.lockstep:
            flags |= drive_link.LOCKSTEP
        counts = tuple(round(p / 1e-6) * 1e-6 for p in self.position)
        stamp = START + self.tick * 1_000_000
        return drive_link.encode_encoder(self.tick, stamp, counts, (20.0, 20.5, 21.0, 19.0), flags)

    def advance(self):
        """Exact solution of m a = F - b v over one period."""
        for i in range(2):
            if self.blocked:
                self.velocity[i] = 0.0
                continue
            mass, viscous = self.mass[i], self.viscous[i]
            final = self.force[i] / viscous
            decay = math.exp(-viscous * PERIOD / mass)
            difference = self.velocity[i] - final
            self.position[i] += final * PERIOD + difference * (1 - decay) * mass / viscous
            self.velocity[i] = final + difference * decay
        self.trace.append((tuple(self.position), tuple(self.velocity)))
        self.tick += 1

    def reset(self, position=(0.0, 0.0)):
        self.position, self.velocity, self.tick = list(position), [0.0, 0.0], 0
        if self.driver:
            self.socket.sendto(self.packet(drive_link.RESET), self.driver)

    def run(self):
        due = None
        while not self.ended.is_set():
            if not self.lockstep and self.driver:
                due = due or time.monotonic()
                self.socket.settimeout(max(due - time.monotonic(), 0.0001))
            try:
                data, sender = self.socket.recvfrom(256)
                message = drive_link.decode(data)
                if message.kind == drive_link.HELLO:
                    self.driver = sender
                    self.send()
                elif message.kind == drive_link.FORCE:
                    self.force, self.last_force_tick = list(message.values), message.tick
                    if self.lockstep and message.tick == self.tick:
                        self.advance()
                        self.send()
            except OSError:
                if self.lockstep and self.driver:
                    self.send(drive_link.REPEATED)
            now = time.monotonic()
            # Time waits a little for a driver that a busy machine holds up, as the twin's does.
            if self.last_force_tick == self.tick - 1 >= 0 and due and now < due + self.patience:
                continue
            if not self.lockstep and due and now >= due:
                if self.tick - self.last_force_tick > 20:
                    self.force = [-2000.0 * v for v in self.velocity]
                self.advance()
                self.send()
                due = max(due + PERIOD, now)

    def send(self, flags=0):
        if not self.muted:
            self.socket.sendto(self.packet(flags), self.driver)

    def close(self):
        self.ended.set()
        self.join(timeout=5)
        self.socket.close()


class Recorder:
    """Listener that keeps everything."""

    def __init__(self):
        self.states, self.controls, self.temperatures, self.events = [], [], [], []
        self.changed = threading.Condition()
        #: Called with every state, in the driver's thread.
        self.delay = lambda: None

    def on_measured(self, stamp, positions):
        """For a controller in the driver's process."""

    def on_state(self, stamp, positions, velocities):
        self.delay()
        with self.changed:
            self.states.append((stamp, tuple(positions), tuple(velocities)))
            self.changed.notify_all()

    def on_control(self, stamp, references, rates, commands, forces):
        with self.changed:
            self.controls.append(
                (stamp, tuple(references), tuple(rates), tuple(commands), tuple(forces))
            )
            self.changed.notify_all()

    def on_temperatures(self, stamp, sensors, values):
        self.temperatures.append((stamp, tuple(sensors), tuple(values)))

    def on_event(self, level, text):
        with self.changed:
            self.events.append((level, text))
            self.changed.notify_all()

    def wait(self, condition, timeout=PATIENCE):
        with self.changed:
            assert self.changed.wait_for(condition, timeout), self.events[-3:]

    def said(self, words):
        return any(words in text for _, text in self.events)
