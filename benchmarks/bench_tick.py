"""Cost of one control tick with every term on, called from Python as the node calls it.

python benchmarks/bench_tick.py
"""

from __future__ import annotations

import time
import tracemalloc

import numpy as np

from contour_ctrl import curves, reference
from contour_ctrl.cmac import CmacSettings
from contour_ctrl.friction import LuGre
from contour_ctrl.tick import Controller, Gains, tick


def main() -> None:
    """Print median, 99th percentile, allocations and recompilations."""
    model = LuGre(20.0, 28.0, 5e-3, 1e7)
    ref = reference.plan(curves.eight(0.06, 0.03), 0.05)
    gains = Gains(cross_coupling=20.0, cmac=CmacSettings(), friction=(model, model))
    controller = Controller(ref, gains)
    rng = np.random.default_rng(0)
    q = (ref.position + rng.normal(scale=1e-5, size=ref.position.shape)).tolist()
    compiled = len(tick.signatures)
    costs = np.empty(len(q))
    for k, (x, y) in enumerate(q):
        begin = time.perf_counter()
        controller.tick(k, x, y)
        costs[k] = time.perf_counter() - begin
    tracemalloc.start()
    before = tracemalloc.take_snapshot()
    for k, (x, y) in enumerate(q):
        controller.tick(k, x, y)
    kept = sum(
        s.size_diff
        for s in tracemalloc.take_snapshot().compare_to(before, 'filename')
        if 'contour_ctrl' in s.traceback[0].filename
    )
    tracemalloc.stop()
    micro = 1e6 * costs
    print(
        f'{len(q)} ticks: median {np.median(micro):.1f} µs, '
        f'99 % {np.percentile(micro, 99):.1f} µs, max {micro.max():.0f} µs; '
        f'kept allocations {kept} bytes; '
        f'compiled during the run: {len(tick.signatures) - compiled}'
    )


if __name__ == '__main__':
    main()
