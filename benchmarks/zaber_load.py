"""A Zaber stage at 50 Hz in real time while the whole graph runs: how many cycles come late.

    .venv/bin/python benchmarks/zaber_load.py --seconds 600 [--composed]

Starts the graph of a session, records, and follows a slow circle again and again. A cycle is late
where its positions are measured more than a tenth of a period after they are due, which is one
period after those before. Exit status 1 where one was late by half a period. Run it on a machine
that does nothing else.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks.bench_load import Load, arguments, homed, intervals

PERIOD = 0.02
#: Shares of a period by which a cycle may be late, and are counted.
LATE = (0.1, 0.25, 0.5, 1.0)
#: A circle of 6 s, three times a run.
CIRCLE: dict[str, object] = {'radius': 0.004, 'feed': 0.004}
COUNTED = (
    ('stage_driver: state', ('missed_polls', 'reconnections', 'watchdog_stops', 'refused')),
    ('stage_driver: state', ('line_timeouts', 'line_retries', 'line_garbage', 'line_strays')),
    ('contour_ctrl: timing', ('missed_ticks', 'interval_p99_ms', 'interval_max_ms')),
)


def report(steps: np.ndarray) -> int:
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
    return counts[LATE.index(0.5)]


def main() -> int:
    """Run the graph and count."""
    given = arguments(__doc__).parse_args()
    services = ('/contour_ctrl/run',)
    with homed(services, CIRCLE, backend='zaber', composed=given.composed) as (nodes, watch):
        load = Load(nodes, watch, services)
        print(f'{given.seconds:.0f} s', flush=True)
        load.last(given.seconds)
        late = report(intervals(list(watch.encoder.copy())))
        load.told(COUNTED)
        load.end()
    return int(late > 0)


if __name__ == '__main__':
    sys.exit(main())
