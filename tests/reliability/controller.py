"""A controller as a process that streams velocities to and fro, and can die or talk rubbish."""

from __future__ import annotations

import signal
import subprocess
import sys

from stage_bringup.processes import die_with_parent
from stage_driver.inbox_backend import ASKED_PAUSE

from .rig import PATIENCE, Watch

SPEED = 0.1
#: Twice the pause of the stream that the driver asks for after a stop, at 1 kHz.
PAUSE_TICKS = round(2000 * ASKED_PAUSE)

#: A controller: velocity set-points to and fro at 200 Hz, stamped with the stage's own time.
#: `both` adds the position; a line on stdin turns it into a flood of NaN.
CONTROLLER = """
import select, sys, time
from sensor_msgs.msg import JointState
from stage_core import topics
from stage_core.ros.client_node import GraphClient
from stage_core.ros.node import SETPOINT_QOS, joint_state, stamp_of

kind, speed = sys.argv[1], float(sys.argv[2])
with GraphClient('controller') as client:
    client.watch(JointState, topics.JOINT_STATES)
    out = client.node.create_publisher(JointState, topics.SETPOINT, SETPOINT_QOS)
    client.wait_for(lambda: client.latest(topics.JOINT_STATES) is not None, 300.0, 'the stage')
    client.wait_for(lambda: out.get_subscription_count() > 1, 300.0, 'driver and test')
    print('ready', flush=True)
    first = client.latest(topics.JOINT_STATES)
    begin, start = stamp_of(first.header), first.position[0]
    rubbish = False
    while True:
        if not rubbish and select.select([sys.stdin], [], [], 0.0)[0]:
            rubbish = True
        newest = client.latest(topics.JOINT_STATES)
        stamp, here = stamp_of(newest.header), newest.position[0]
        position = start + speed * (stamp - begin) * 1e-9
        if abs(position - here) > 0.003 and here < 0.1:
            # Stopped meanwhile, or late: go on from where the stage is; not so near the limit.
            begin, start = stamp, here
            position = here
        velocity = speed + (10.0 * (position - here) if kind == 'both' else 0.0)
        if rubbish:
            position = velocity = float('nan')
        out.publish(joint_state(stamp, ('x', 'y'),
            position=(position, 0.0) if kind == 'both' else None, velocity=(velocity, 0.0)))
        time.sleep(0.0 if rubbish else 0.005)
"""


class Controller:
    """The streaming process, started and followed at speed."""

    def __init__(self, kind: str, speed: float = SPEED) -> None:
        self.process = subprocess.Popen(
            [sys.executable, '-c', CONTROLLER, kind, str(speed)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            preexec_fn=die_with_parent if sys.platform == 'linux' else None,
        )
        assert self.process.stdout is not None
        assert self.process.stdout.readline().strip() == 'ready'

    def follow(self, watch: Watch, until: float) -> None:
        """Wait until the stage is under way and has passed x = `until` [m]."""
        for _ in range(10):
            try:
                watch.wait(lambda: watch.encoder[-1][1] > until, f'the way to {until} m', 6.0)
                return
            except AssertionError:
                # Stopped while the machine did something else; the stage is still homed.
                self._pause(watch)
        raise AssertionError(f'no stream: {watch.states}')

    def _pause(self, watch: Watch) -> None:
        """Pause the stream as the driver asks after a stop, counted in ticks of the stage."""
        self.process.send_signal(signal.SIGSTOP)
        count = len(watch.encoder)
        watch.wait(lambda: len(watch.encoder) > count + PAUSE_TICKS, 'ticks of the pause')
        watch.client.trigger('/stage_driver/reset_fault', PATIENCE)
        self.process.send_signal(signal.SIGCONT)

    def rubbish(self) -> None:
        """Send nothing but NaN from now on."""
        assert self.process.stdin is not None
        self.process.stdin.write('\n')
        self.process.stdin.flush()

    def end(self) -> None:
        self.process.kill()
        self.process.communicate()
