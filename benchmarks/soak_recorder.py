"""Soak test of the recorder: six topics at 1 kHz, losses and memory; exit 1 if one was lost.

Run: .venv/bin/python benchmarks/soak_recorder.py --minutes 60

With --held 0.5 the recorder is suspended for half a second again and again, as on a machine that
has no processor left for it: what the socket cannot hold must be asked for and sent again.
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
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / 'tests'))

from domains import reserve_domain

PUBLISHER = """
import sys, time, rclpy
from sensor_msgs.msg import JointState
from stage_core.ros.node import STATE_QOS, joint_state
rclpy.init()
node = rclpy.create_node('publisher')
publishers = [node.create_publisher(JointState, name, STATE_QOS) for name in sys.argv[3:]]
while any(p.get_subscription_count() == 0 for p in publishers):
    time.sleep(0.1)
print('ready', flush=True)
sys.stdin.readline()
period = round(1e9 / float(sys.argv[2]))
begin, count = time.time_ns(), int(float(sys.argv[1]) * 60e9 / period)
for k in range(count):
    stamp = begin + k * period
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


class Holdup(threading.Thread):
    """Suspends a process for `seconds` every two seconds."""

    def __init__(self, process: subprocess.Popen[bytes], seconds: float) -> None:
        super().__init__(daemon=True)
        self.process, self.seconds = process, seconds
        self.times = 0
        self.ended = threading.Event()

    def run(self) -> None:
        """Suspend and resume until `ended`."""
        while not self.ended.wait(2.0):
            self.process.send_signal(signal.SIGSTOP)
            time.sleep(self.seconds)
            self.process.send_signal(signal.SIGCONT)
            self.times += 1


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


def started(folder: str, minutes: float, rate: float) -> tuple[Any, Any]:
    """Recorder, and publisher, which has told that everybody listens."""
    recorder = subprocess.Popen(
        [sys.executable, '-c', 'from session_bags.recorder_node import main; main()',
         '--ros-args', '-p', f'directory:={folder}', '-p', f'topics:=[{", ".join(TOPICS)}]']
    )  # fmt: skip
    publisher = subprocess.Popen(
        [sys.executable, '-c', PUBLISHER, str(minutes), str(rate), *TOPICS],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert publisher.stdout is not None
    publisher.stdout.readline()
    return recorder, publisher


def published(publisher: Any) -> int:
    """Let the publisher begin, and wait until it has sent everything; how many messages."""
    publisher.stdin.write('\n')
    publisher.stdin.flush()
    answer = publisher.stdout.readline()
    if not answer:
        raise SystemExit('error: the publisher was ended before its time')
    return int(answer)


def processor_time(process: int) -> float:
    """Processor time of a process so far [s]."""
    stat = Path(f'/proc/{process}/stat').read_text().rsplit(')', 1)[1].split()
    return (int(stat[11]) + int(stat[12])) / os.sysconf('SC_CLK_TCK')


def soak(folder: str, minutes: float, rate: float, held: float) -> int:
    """Record, count, print; how many messages were lost."""
    from session_bags.bag import open_bag
    from session_bags.info import contents
    from stage_core.ros.client_node import GraphClient

    recorder, publisher = started(folder, minutes, rate)
    try:
        with GraphClient('soak') as client:
            path = client.trigger('/session_recorder/start')
            time.sleep(2.0)
            before = memory(recorder.pid)
            sampler, holdup = Memory(recorder.pid), Holdup(recorder, held)
            sampler.start()
            if held:
                holdup.start()
            begun = time.monotonic()
            sent = published(publisher)
            holdup.ended.set()
            time.sleep(2.0 + 2.0 * held)
            sampler.ended.set()
            after = memory(recorder.pid)
            share = processor_time(recorder.pid) / (time.monotonic() - begun)
            print(client.trigger('/session_recorder/stop'))
    finally:
        publisher.kill()
        recorder.send_signal(signal.SIGCONT)
        recorder.send_signal(signal.SIGTERM)
        for process in (publisher, recorder):
            process.wait(timeout=20)
    if holdup.times:
        print(f'recorder suspended {holdup.times} times for {held} s')
    found = sum(contents(open_bag(path)).counts.values())
    print(
        f'{minutes:g} min, 6 topics at {rate:g} Hz: {sent} sent, {found} recorded, '
        f'{sent - found} lost; recorder {100 * share:.0f} % of a core, '
        f'memory {before:.0f} -> {after:.0f} MiB, largest {sampler.largest:.0f} MiB'
    )
    return sent - found


def main() -> int:
    """Soak; exit 1 if a message was lost."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--minutes', type=float, default=1.0)
    parser.add_argument('--rate', type=float, default=1000.0, help='of each topic [Hz]')
    parser.add_argument('--held', type=float, default=0.0, help='suspend the recorder for [s]')
    given = parser.parse_args()
    reserve_domain()
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    with tempfile.TemporaryDirectory() as folder:
        return int(soak(folder, given.minutes, given.rate, given.held) != 0)


if __name__ == '__main__':
    sys.exit(main())
