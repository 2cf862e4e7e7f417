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
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from std_srvs.srv import Trigger

from benchmarks.processor_gaps import ProcessorGaps
from stage_bringup.graph import Options
from stage_core.errors import StageError
from tests.domains import reserve_domain
from tests.reliability.rig import Nodes, Watch, running

PERIOD = 1e-3
#: Limits that the figures stand beside.
STOP_LIMIT = 0.02
MISSED_LIMIT = 0.001
#: What the nodes count of it.
COUNTED = (
    ('stage_driver: state', ('missed_ticks', 'late_ticks', 'watchdog_stops')),
    (
        'stage_twin: plant',
        ('held_ticks', 'late_forces', 'missed_ticks', 'pauses', 'worst_lateness'),
    ),
    ('contour_ctrl: timing', ('missed_ticks', 'interval_p99_ms', 'callback_p99_us')),
)
TICKS_PER_SECOND = os.sysconf('SC_CLK_TCK')
#: A circle of 3 s, again and again.
CIRCLE: dict[str, object] = {
    'radius': 0.01, 'feed': 0.02, 'iterations': 3, 'approach_timeout': 3.0,
}  # fmt: skip


def processor_time(pid: int) -> float:
    """User and system time of a process so far, ended children included [s]."""
    fields = Path(f'/proc/{pid}/stat').read_text().rsplit(')', 1)[1].split()
    return sum(int(fields[i]) for i in (11, 12, 13, 14)) / TICKS_PER_SECOND


def record(watch: Watch) -> str:
    """Record a bag of moves to train and diagnose from; its path."""
    bag = watch.client.trigger('/session_recorder/start').split()[-1]
    for x in np.linspace(-0.03, 0.03, 4):
        for y in np.linspace(-0.03, 0.03, 4):
            watch.move(float(x), float(y))
            watch.wait(watch.arrived(float(x), float(y)), 'a move')
            time.sleep(0.4)
    watch.client.trigger('/session_recorder/stop')
    return str(bag)


class Load:
    """Services that are called again and again while a bag is recorded, and what that costs."""

    def __init__(self, nodes: Nodes, watch: Watch, services: Sequence[str]) -> None:
        self.watch = watch
        #: Of each service the answers and the failures.
        self.counts = {name: [0, 0] for name in services}
        self.ended = threading.Event()
        watch.client.trigger('/session_recorder/start')
        pids = {name: process.pid for name, process in nodes.running.items()}
        pids['(this benchmark)'] = os.getpid()
        self.begun = {name: (pid, processor_time(pid)) for name, pid in pids.items()}
        watch.encoder.clear()
        self.begin = time.monotonic()
        for name in services:
            # Daemons: a call may still wait for an answer when the time is over.
            threading.Thread(target=self._repeat, args=(name,), daemon=True).start()

    def _repeat(self, name: str) -> None:
        while not self.ended.is_set():
            try:
                self.watch.client.trigger(name, 600.0)
                self.counts[name][0] += 1
            except StageError as error:
                self.counts[name][1] += 1
                print(f'  {name}: {error}')
                time.sleep(1.0)

    def last(self, seconds: float) -> None:
        """Let time pass; prints what the machine itself left out."""
        with ProcessorGaps() as gaps:
            time.sleep(seconds)
        print(gaps.text)

    def told(self, keys: Sequence[tuple[str, Sequence[str]]]) -> None:
        """Print values of statuses on /diagnostics, and what driver and recorder say."""
        for status, names in keys:
            shown = ', '.join(f'{n} {self.watch.value(status, n) or "-"}' for n in names)
            print(f'{status:22s} {shown}')
        print(f'driver                 {self.watch.text("stage_driver: state")}')
        print(f'recording              {self.watch.text("session_recorder: recording")}')

    def end(self) -> None:
        """Print the processor time of each node and what was answered; nothing more is asked."""
        self.ended.set()
        seconds, total = time.monotonic() - self.begin, 0.0
        for name, (pid, before) in self.begun.items():
            used = processor_time(pid) - before
            total += used
            print(f'CPU {name:18s} {100 * used / seconds:5.0f} % of a core')
        print(f'CPU of all             {100 * total / seconds:5.0f} % of {os.cpu_count()} cores')
        for name, (done, failed) in self.counts.items():
            print(f'{name:26s} {done} answered, {failed} failed')


@contextmanager
def homed(
    services: Sequence[str], circle: dict[str, object], **options: object
) -> Iterator[tuple[Nodes, Watch]]:
    """The graph of a session in real time; the contour controller follows a circle when asked."""
    reserve_domain()
    prefixed = {f'contour_ctrl:{name}': value for name, value in circle.items()}
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / 'out'
        # The emulated Zaber chain links its terminal there.
        out.mkdir()
        given = Options(clock='realtime', out=out, **options)  # type: ignore[arg-type]
        with running(given, lean=True, contour_ctrl=circle, control=prefixed) as (nodes, watch):
            for service in ('/stage_driver/home', '/session_recorder/start', *services):
                watch.client.wait_for_service(service, 180.0)
            watch.wait(lambda: len(watch.encoder) > 0, 'the stage', 180.0)
            watch.home()
            yield nodes, watch


def arguments(description: str) -> argparse.ArgumentParser:
    """The arguments that every load has."""
    parser = argparse.ArgumentParser(description=description.splitlines()[0])
    parser.add_argument('--seconds', type=float, default=60.0)
    parser.add_argument(
        '--composed', action='store_true', help='driver and contour controller in one process'
    )
    return parser


def intervals(rows: list[tuple[int, float, float]]) -> np.ndarray:
    """Differences of stamps [s]."""
    return 1e-9 * np.diff(np.array([row[0] for row in rows], dtype=np.int64))


def report(watch: Watch, stops: np.ndarray, seconds: float) -> None:
    """Print what the ticks and the stops say."""
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


def main() -> int:
    """Run the load."""
    parser = arguments(__doc__)
    parser.add_argument('--untrained', action='store_true', help='neither training nor diagnosis')
    given = parser.parse_args()
    busy = () if given.untrained else ('/calibrator/retrain', '/gap_diagnosis/diagnose')
    services = (*busy, '/contour_ctrl/run')
    with homed(services, CIRCLE, composed=given.composed) as (nodes, watch):
        bag = record(watch)
        for node in ('/calibrator', '/gap_diagnosis'):
            watch.client.set_parameters(node, bag=bag)
        load = Load(nodes, watch, services)
        load.last(given.seconds)
        stops = stop_times(watch)
        report(watch, stops, time.monotonic() - load.begin)
        load.told(COUNTED)
        load.end()
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
