"""Tables 2 and 3 of paper 3 on the servo twin, with the peers that a user would pick instead.

python benchmarks/paper3_tables.py [--seeds 5] [--readings]
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import paper3_rig as rig

from contour_ctrl.cmac import CmacSettings
from contour_ctrl.figures import Figures
from contour_ctrl.learning import LearningSettings
from contour_ctrl.tick import Gains

PAPER = {
    '1: PI + CCCMAC': (215.874, 217.527, 16.455),
    '2: + ILC': (34.517, 31.021, 13.058),
    '3: + fuzzy RILC': (15.221, 22.126, 8.524),
}
Runs = Callable[[int], Figures]


def row(name: str, runs: Runs, seeds: int) -> np.ndarray:
    """Print a line of means over the seeds; return them (9,) in um."""
    table = []
    for seed in range(seeds):
        f = runs(seed)
        table.append(
            [
                f.tracking_rms[0],
                f.tracking_aiae[0],
                f.tracking_max[0],
                f.tracking_rms[1],
                f.tracking_aiae[1],
                f.tracking_max[1],
                f.contour_rms,
                f.contour_aiae,
                f.contour_max,
            ]
        )
    values = 1e6 * np.array(table)
    mean, std = values.mean(axis=0), values.std(axis=0)
    cells = ' | '.join(f'{value:.2f}' for value in mean)
    print(f'| {name} | {cells} | {std[0]:.2f}, {std[6]:.2f} |', flush=True)
    return np.asarray(mean)


def header(title: str) -> None:
    """Print the head of a table."""
    print(f'\n{title}\n')
    print('| scheme | X RMS | AIAE | max | Y RMS | AIAE | max | contour RMS | AIAE | max | std |')
    print('|---|---|---|---|---|---|---|---|---|---|---|')


def ratios(name: str, first: np.ndarray, last: np.ndarray) -> None:
    """Print the improvement of a scheme."""
    print(
        f'{name}: tracking RMS X / {first[0] / last[0]:.1f}, Y / {first[3] / last[3]:.1f}, '
        f'contour RMS / {first[6] / last[6]:.2f}'
    )


def tables(title: str, gains: Gains, rate: float, seeds: int) -> None:
    """Schemes 1 to 3 with one velocity feed-forward."""
    header(title)

    def last(settings: LearningSettings | None) -> Runs:
        return lambda seed: rig.learn(seed, gains, settings)[0][-1]

    pair = rate, rate
    fixed = LearningSettings(pair, rig.CUTOFF, reinforced=False, divergence=0.0)
    fuzzy = LearningSettings(pair, rig.CUTOFF, divergence=0.0)
    first = row('1, first lap', lambda seed: rig.learn(seed, gains, None, 1)[0][0], seeds)
    settled = row('1, lap 30', last(None), seeds)
    row('2, best iteration', lambda seed: best(rig.learn(seed, gains, fixed)[0]), seeds)
    row('2, iteration 30', last(fixed), seeds)
    third = row('3, iteration 30', last(fuzzy), seeds)
    half = LearningSettings((rate / 2, rate / 2), rig.CUTOFF, reinforced=False, divergence=0.0)
    row('2 with half the rate', last(half), seeds)
    lead = LearningSettings(pair, 80.0, 5, divergence=0.0)
    ours = row('3 + lead of 5 ticks, Q 80 Hz', last(lead), seeds)
    print()
    ratios('3 against 1 (first lap)', first, third)
    ratios('3 against 1 (lap 30)', settled, third)
    ratios('3 + lead against 1 (first lap)', first, ours)
    ratios('3 + lead against 1 (lap 30)', settled, ours)


def best(results: list[Figures]) -> Figures:
    """Iteration with the smallest tracking RMS."""
    return min(results, key=lambda f: float(f.tracking_rms.sum()))


def peers(tuned: rig.Tuned, seeds: int) -> None:
    """What a user would pick instead."""
    header('Peers: P + velocity and acceleration feed-forward; norm-optimal ILC on top of it')
    row('P + feed-forward', lambda s: rig.learn(s, tuned.feed_forward, None, 1)[0][0], seeds)
    row(
        'norm-optimal ILC, iteration 30',
        lambda s: rig.norm_optimal(s, tuned.feed_forward, 0.0, 1e-4)[-1],
        seeds,
    )


def readings(tuned: rig.Tuned, rate: float, seeds: int) -> None:
    """Literal equations against the recommended reading."""
    header('Readings: CMAC update (scheme 1, lap 30) and regulator (scheme 3, iteration 30)')
    cmacs: dict[str, CmacSettings | None] = {
        'fixed K_c, no CMAC': None,
        'CMAC literal, lambda 20': CmacSettings(rate=20.0, mode='literal'),
        'CMAC literal, lambda 60': CmacSettings(rate=60.0, mode='literal'),
        'CMAC gradient (default)': tuned.scheme_1.cmac,
    }
    for name, settings in cmacs.items():
        gains = replace(tuned.scheme_1, cmac=settings)
        row(name, lambda s, g=gains: rig.learn(s, g, None)[0][-1], seeds)
    for reading in ('literal', 'recommended'):
        settings = LearningSettings((rate, rate), rig.CUTOFF, reading=reading, divergence=0.0)
        row(
            f'regulator {reading}',
            lambda s, c=settings: rig.learn(s, tuned.scheme_1, c)[0][-1],
            seeds,
        )


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--seeds', type=int, default=5, help='machines per row')
    parser.add_argument('--readings', action='store_true', help='only the table of readings')
    given = parser.parse_args()
    begin = time.perf_counter()
    tuned = rig.tune()
    rate = rig.first_rate(tuned.base.position[0])
    assert tuned.scheme_1.cmac is not None
    print(
        f'K_p {tuned.base.position} 1/s (max |S| {rig.SENSITIVITY}), K_c '
        f'{tuned.scheme_1.cross_coupling:g} 1/s, CMAC rate {tuned.scheme_1.cmac.rate:g} 1/s^2, '
        f'L_initial {rate:g} 1/s, Q {rig.CUTOFF:g} Hz, K_a of the peer '
        f'{tuned.feed_forward.acceleration_feedforward[0]:g} s; circle of {rig.RADIUS} m at '
        f'{rig.FEED} m/s; means over {given.seeds} machines, um; std of X RMS and contour RMS'
    )
    if given.readings:
        readings(tuned, rate, given.seeds)
    else:
        print(
            'paper (X RMS, Y RMS, contour RMS): '
            + '; '.join(f'{name} {x} {y} {c}' for name, (x, y, c) in PAPER.items())
        )
        none = replace(tuned.scheme_1, velocity_feedforward=(0.0, 0.0))
        tables(
            'K_f = 0: the tracking error is the lag v / K_p, as its size in the paper says',
            none,
            rate,
            given.seeds,
        )
        tables('K_f = 1: eq. 24 as written', tuned.scheme_1, rate, given.seeds)
        peers(tuned, given.seeds)
    print(f'\n{time.perf_counter() - begin:.0f} s')


if __name__ == '__main__':
    main()
