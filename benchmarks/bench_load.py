"""Everything at once: all nodes at 1 kHz, recorder, retraining and diagnosis; beside the limits.

    .venv/bin/python benchmarks/bench_load.py --seconds 60 [--composed] [--untrained]

Starts the graph of a session in real time, records a bag of moves, then follows a circle while
the calibrator is retrained and the gap diagnosed from that bag again and again. Prints missed
ticks, jitter, latency percentiles and CPU per node. Run it on a machine that does nothing else.
--untrained: neither training nor diagnosis, to see what the nodes themselves need.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import threading
import time
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from std_srvs.srv import Trigger

from benchmarks.processor_gaps import ProcessorGaps
from stage_bringup.graph import Options
from stage_core.errors import StageError
from tests.domains import reserve_domain
from tests.reliability.rig import Watch, running

PERIOD = 1e-3
#: Limits that the figures stand beside.
STOP_LIMIT = 0.02
MISSED_LIMIT = 0.001
TICKS_PER_SECOND = os.sysconf('SC_CLK_TCK')
#: A circle of 3 s, again and again, wherever the contour controller runs.
CIRCLE = {'radius': 0.01, 'feed': 0.02, 'iterations': 3, 'approach_timeout': 3.0}
CIRCLES: dict[str, dict[str, object]] = {
    'contour_ctrl': {**CIRCLE},
    'control': {f'contour_ctrl:{name}': value for name, value in CIRCLE.items()},
}


@dataclass
class Cpu:
    """CPU time of a process and of its children [s] at the begin."""

    pid: int
    begin: float

    @classmethod
    def of(cls, pid: int) -> Cpu:
        """Begin to count."""
        return cls(pid, cls.read(pid))

    @staticmethod
    def read(pid: int) -> float:
        """User and system time so far, ended children included [s]."""
        fields = Path(f'/proc/{pid}/stat').read_text().rsplit(')', 1)[1].split()
        return sum(int(fields[i]) for i in (11, 12, 13, 14)) / TICKS_PER_SECOND

    @property
    def used(self) -> float:
        """CPU time since the begin [s]."""
        return self.read(self.pid) - self.begin


def record(watch: Watch) -> str:
    """Record a bag of moves to train and diagnose from; its path."""
    watch.home()
    bag = watch.client.trigger('/session_recorder/start').split()[-1]
    for x in np.linspace(-0.03, 0.03, 4):
        for y in np.linspace(-0.03, 0.03, 4):
            watch.move(float(x), float(y))
            watch.wait(watch.arrived(float(x), float(y)), 'a move')
            time.sleep(0.4)
    watch.client.trigger('/session_recorder/stop')
    return str(bag)


def repeat(ended: threading.Event, counts: dict[str, list[int]], watch: Watch, name: str) -> None:
    """Call a long service again and again; count answers and failures."""
    while not ended.is_set():
        try:
            watch.client.trigger(name, 600.0)
            counts[name][0] += 1
        except StageError as error:
            counts[name][1] += 1
            print(f'  {name}: {error}')
            time.sleep(1.0)


def intervals(rows: list[tuple[int, float, float]]) -> np.ndarray:
    """Differences of stamps [s]."""
    return 1e-9 * np.diff(np.array([row[0] for row in rows], dtype=np.int64))


def report(watch: Watch, cpu: dict[str, Cpu], stops: np.ndarray, seconds: float) -> None:
    """Print the table."""
    steps = intervals(list(watch.encoder))
    missed = int(np.sum(np.rint(steps / PERIOD) - 1))
    print(f'\n{seconds:.0f} s; {len(steps)} ticks on /stage/joint_states')
    share = missed / max(len(steps), 1)
    print(f'missed ticks           {missed} ({100 * share:.2f} %; limit {100 * MISSED_LIMIT:g} %)')
    jitter = 1e6 * np.percentile(np.abs(steps - PERIOD), (50, 99, 100))
    print(
        'jitter of the stamps   median {:.0f} us, 99 % {:.0f} us, worst {:.0f} us'.format(*jitter)
    )
    values = 1e3 * np.percentile(stops, (50, 95, 99, 100))
    print(
        'answer of ~/stop       median {:.1f} ms, 95 % {:.1f} ms, 99 % {:.1f} ms, worst {:.1f} ms'
        '; limit {:.0f} ms'.format(*values, 1e3 * STOP_LIMIT)
    )
    for status, keys in (
        ('stage_driver: state', ('missed_ticks', 'late_ticks', 'watchdog_stops')),
        (
            'stage_twin: plant',
            ('held_ticks', 'late_forces', 'missed_ticks', 'pauses', 'worst_lateness'),
        ),
        ('contour_ctrl: timing', ('missed_ticks', 'interval_p99_ms', 'callback_p99_us')),
    ):
        shown = ', '.join(f'{key} {watch.value(status, key) or "-"}' for key in keys)
        print(f'{status:22s} {shown}')
    print(f'driver                 {watch.text("stage_driver: state")}')
    print(f'recording              {watch.text("session_recorder: recording")}')
    total = 0.0
    for name, used in cpu.items():
        total += used.used
        print(f'CPU {name:18s} {100 * used.used / seconds:5.0f} % of a core')
    print(f'CPU of all             {100 * total / seconds:5.0f} % of {os.cpu_count()} cores')


def main() -> int:
    """Run the load."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--seconds', type=float, default=60.0)
    parser.add_argument(
        '--composed', action='store_true', help='driver and contour controller in one process'
    )
    parser.add_argument('--untrained', action='store_true', help='neither training nor diagnosis')
    given = parser.parse_args()
    seconds = given.seconds
    reserve_domain()
    busy = () if given.untrained else ('/calibrator/retrain', '/gap_diagnosis/diagnose')
    counts = {name: [0, 0] for name in (*busy, '/contour_ctrl/run')}
    ended = threading.Event()
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        options = Options(clock='realtime', composed=given.composed, out=Path(folder) / 'out')
        nodes, watch = stack.enter_context(running(options, lean=True, **CIRCLES))
        stack.callback(ended.set)
        watch.wait(lambda: len(watch.encoder) > 0, 'the stage', 180.0)
        client = watch.client
        for service in ('/session_recorder/start', *counts):
            client.wait_for_service(service, 90.0)
        bag = record(watch)
        client.set_parameters('/calibrator', bag=bag)
        client.set_parameters('/gap_diagnosis', bag=bag)
        client.trigger('/session_recorder/start')
        cpu = {name: Cpu.of(p.pid) for name, p in nodes.running.items()}
        cpu['(this benchmark)'] = Cpu.of(os.getpid())
        watch.encoder.clear()
        begin = time.monotonic()
        for name in counts:
            # Daemons: a call may still wait for an answer when the time is over.
            calls = (ended, counts, watch, name)
            threading.Thread(target=repeat, args=calls, daemon=True).start()
        with ProcessorGaps() as gaps:
            time.sleep(seconds)
        stops = stop_times(watch)
        print(gaps.text)
        report(watch, cpu, stops, time.monotonic() - begin)
        ended.set()
        for name, (done, failed) in counts.items():
            print(f'{name:26s} {done} answered, {failed} failed')
    return 0


def stop_times(watch: Watch, calls: int = 50) -> np.ndarray:
    """Answer times of `~/stop` [s] while everything else is busy."""
    stop = watch.client.node.create_client(Trigger, '/stage_driver/stop')
    stop.wait_for_service(30.0)
    durations = []
    for _ in range(calls):
        done = threading.Event()
        begin = time.perf_counter()
        stop.call_async(Trigger.Request()).add_done_callback(lambda _, d=done: d.set())
        done.wait(10.0)
        durations.append(time.perf_counter() - begin)
        time.sleep(0.05)
    return np.array(durations)


if __name__ == '__main__':
    sys.exit(main())
