"""Soak test of the recorder: six topics at 1 kHz, losses and memory.

Run: .venv/bin/python benchmarks/soak_recorder.py --minutes 60
"""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / 'tests'))

from domains import reserve_domain

PUBLISHER = """
import sys, time, rclpy
from sensor_msgs.msg import JointState
from stage_core import topics
from stage_node.node import STATE_QOS, joint_state
rclpy.init()
node = rclpy.create_node('publisher')
names = (topics.SETPOINT, topics.REFERENCE, topics.COMMAND, topics.JOINT_STATES,
         topics.TARGET, '/stage/spare')
publishers = [node.create_publisher(JointState, name, STATE_QOS) for name in names]
while any(p.get_subscription_count() == 0 for p in publishers):
    time.sleep(0.1)
print('ready', flush=True)
sys.stdin.readline()
begin, count = time.time_ns(), int(float(sys.argv[1]) * 60_000)
for k in range(count):
    stamp = begin + k * 1_000_000
    wait = stamp - time.time_ns()
    if wait > 0:
        time.sleep(wait * 1e-9)
    for publisher in publishers:
        publisher.publish(joint_state(stamp, ('x', 'y'), [1e-6 * k, 0.0], [1e-3, 0.0]))
print(count * len(publishers), flush=True)
sys.stdin.readline()
"""
TOPICS = (
    '/stage/setpoint', '/stage/reference', '/stage/command', '/stage/joint_states',
    '/stage/target', '/stage/spare',
)  # fmt: skip


def memory(process: int) -> float:
    """Resident memory of a process [MiB]."""
    pages = int(Path(f'/proc/{process}/statm').read_text().split()[1])
    return pages * os.sysconf('SC_PAGE_SIZE') / 2**20


class Memory(threading.Thread):
    """Samples the resident memory of a process every second; the largest [MiB]."""

    def __init__(self, process: int) -> None:
        super().__init__(daemon=True)
        self.process = process
        self.largest = memory(process)
        self.ended = threading.Event()

    def run(self) -> None:
        """Sample until `ended`."""
        while not self.ended.wait(1.0):
            self.largest = max(self.largest, memory(self.process))


def main() -> int:
    """Record, count, print; exit 1 if a message was lost."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--minutes', type=float, default=1.0)
    minutes = parser.parse_args().minutes
    reserve_domain()
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    from session_bags.bag import open_bag
    from session_bags.info import contents
    from stage_node.client_node import GraphClient

    with tempfile.TemporaryDirectory() as folder:
        recorder = subprocess.Popen(
            [sys.executable, '-c', 'from session_bags.recorder_node import main; main()',
             '--ros-args', '-p', f'directory:={folder}', '-p', f'topics:=[{", ".join(TOPICS)}]']
        )  # fmt: skip
        publisher = subprocess.Popen(
            [sys.executable, '-c', PUBLISHER, str(minutes)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        assert publisher.stdin is not None and publisher.stdout is not None
        try:
            publisher.stdout.readline()
            with GraphClient('soak') as client:
                path = client.trigger('/session_recorder/start')
                time.sleep(2.0)
                before = memory(recorder.pid)
                sampler = Memory(recorder.pid)
                sampler.start()
                cpu = os.times()
                publisher.stdin.write('\n')
                publisher.stdin.flush()
                answer = publisher.stdout.readline()
                if not answer:
                    raise SystemExit('error: the publisher was ended before its time')
                sent = int(answer)
                time.sleep(2.0)
                sampler.ended.set()
                after = memory(recorder.pid)
                stat = Path(f'/proc/{recorder.pid}/stat').read_text().rsplit(')', 1)[1].split()
                seconds = (int(stat[11]) + int(stat[12])) / os.sysconf('SC_CLK_TCK')
                share = seconds / (os.times().elapsed - cpu.elapsed)
                print(client.trigger('/session_recorder/stop'))
        finally:
            publisher.kill()
            recorder.send_signal(signal.SIGTERM)
            for process in (publisher, recorder):
                process.wait(timeout=20)
        found = sum(contents(open_bag(path)).counts.values())
        print(
            f'{minutes:g} min, 6 topics at 1 kHz: {sent} sent, {found} recorded, '
            f'{sent - found} lost; recorder {100 * share:.0f} % of a core, '
            f'memory {before:.0f} -> {after:.0f} MiB, largest {sampler.largest:.0f} MiB'
        )
    return int(sent != found)


if __name__ == '__main__':
    sys.exit(main())
