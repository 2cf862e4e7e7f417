"""A Zaber stage at 50 Hz in real time while the whole graph runs: how many cycles come late.

    .venv/bin/python benchmarks/zaber_load.py --seconds 600 [--composed]

Starts the graph of a session, records, and follows a slow circle again and again. A cycle is late
where its positions are measured more than a tenth of a period after they are due, which is one
period after those before. Exit status 1 where one was late by half a period. Run it on a machine
that does nothing else.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import threading
import time
from collections import deque
from contextlib import ExitStack
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks.bench_load import Cpu, intervals, repeat
from benchmarks.processor_gaps import ProcessorGaps
from stage_bringup.graph import Options
from tests.domains import reserve_domain
from tests.reliability.rig import Watch, running

PERIOD = 0.02
#: Shares of a period by which a cycle may be late, and are counted.
LATE = (0.1, 0.25, 0.5, 1.0)
#: A circle of 6 s, three times a run.
CIRCLE = {'radius': 0.004, 'feed': 0.004}


def report(watch: Watch, steps: np.ndarray) -> int:
    """Print what came when; the number of cycles that were late by half a period."""
    late = steps - PERIOD
    print(f'cycles                 {len(steps)}')
    counts = [int(np.sum(late > share * PERIOD)) for share in LATE]
    shown = ', '.join(
        f'{1e3 * share * PERIOD:g} ms: {n}' for share, n in zip(LATE, counts, strict=True)
    )
    print(f'late by more than      {shown}')
    values = 1e3 * np.percentile(steps, (0, 1, 50, 99, 100))
    print(
        'interval [ms]          least {:.2f}, 1 % {:.2f}, median {:.2f}, 99 % {:.2f}, '
        'worst {:.2f}'.format(*values)
    )
    for status, keys in (
        ('stage_driver: state', ('missed_polls', 'reconnections', 'watchdog_stops', 'refused')),
        ('stage_driver: state', ('line_timeouts', 'line_retries', 'line_garbage', 'line_strays')),
        ('contour_ctrl: timing', ('missed_ticks', 'interval_p99_ms', 'interval_max_ms')),
    ):
        found = ', '.join(f'{key} {watch.value(status, key) or "-"}' for key in keys)
        print(f'{status:22s} {found}')
    print(f'driver                 {watch.text("stage_driver: state")}')
    print(f'recording              {watch.text("session_recorder: recording")}')
    return counts[LATE.index(0.5)]


def main() -> int:
    """Run the graph and count."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--seconds', type=float, default=60.0)
    parser.add_argument(
        '--composed', action='store_true', help='driver and contour controller in one process'
    )
    given = parser.parse_args()
    reserve_domain()
    counts = {'/contour_ctrl/run': [0, 0]}
    ended = threading.Event()
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        options = Options(
            backend='zaber', clock='realtime', composed=given.composed, out=Path(folder) / 'out'
        )
        # The emulated chain links its terminal there.
        options.out.mkdir()
        prefixed = {f'contour_ctrl:{name}': value for name, value in CIRCLE.items()}
        nodes, watch = stack.enter_context(
            running(options, lean=True, contour_ctrl=CIRCLE, control=prefixed)
        )
        stack.callback(ended.set)
        for service in ('/stage_driver/home', '/session_recorder/start', *counts):
            watch.client.wait_for_service(service, 180.0)
        watch.wait(lambda: len(watch.encoder) > 0, 'the stage', 180.0)
        watch.home()
        watch.client.trigger('/session_recorder/start')
        cpu = {name: Cpu.of(p.pid) for name, p in nodes.running.items()}
        cpu['(this benchmark)'] = Cpu.of(os.getpid())
        watch.encoder.clear()
        print(f'{given.seconds:.0f} s', flush=True)
        # A daemon: its call may still wait for an answer when the time is over.
        calls = (ended, counts, watch, '/contour_ctrl/run')
        threading.Thread(target=repeat, args=calls, daemon=True).start()
        with ProcessorGaps() as gaps:
            time.sleep(given.seconds)
        rows: deque = watch.encoder.copy()
        print(gaps.text)
        late = report(watch, intervals(list(rows)))
        ended.set()
        for name, process in cpu.items():
            print(f'CPU {name:18s} {100 * process.used / given.seconds:5.0f} % of a core')
        for name, (done, failed) in counts.items():
            print(f'{name:26s} {done} answered, {failed} failed')
    return int(late > 0)


if __name__ == '__main__':
    sys.exit(main())
