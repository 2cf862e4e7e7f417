"""Tables 2 and 3 of paper 3 on the servo twin, with the peers that a user would pick instead.

python benchmarks/paper3_tables.py [--seeds 5] [--settings | --readings | --peers]
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import paper3_rig as rig
from scipy import stats

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
X, Y, CONTOUR = 0, 3, 6


def row(name: str, runs: Runs, seeds: int) -> np.ndarray:
    """Print a line of means over the seeds; return (seeds, 9) in µm."""
    table = []
    for seed in range(seeds):
        f = runs(seed)
        table.append([v for m in (f.x, f.y, f.contour) for v in (m.rms, m.mae, m.max)])
    values = 1e6 * np.array(table)
    mean, std = values.mean(axis=0), values.std(axis=0)
    cells = ' | '.join(f'{value:.2f}' for value in mean)
    print(f'| {name} | {cells} | {std[X]:.2f}, {std[CONTOUR]:.2f} |', flush=True)
    return np.asarray(values)


def final(gains: Gains, settings: LearningSettings | None) -> Runs:
    """The figures of the last iteration of a seed's machine."""
    return lambda seed: rig.learn(seed, gains, settings)[0][-1]


def header(title: str) -> None:
    """Print the head of a table."""
    print(f'\n{title}\n')
    print('| scheme | X RMS | AIAE | max | Y RMS | AIAE | max | contour RMS | AIAE | max | std |')
    print('|---|---|---|---|---|---|---|---|---|---|---|')


def half_width(values: np.ndarray) -> np.ndarray:
    """Half of the 95 % interval of the mean over the first axis."""
    count = len(values)
    spread = values.std(axis=0, ddof=1) / np.sqrt(count)
    return np.asarray(stats.t.ppf(0.975, count - 1) * spread)


def ratios(name: str, first: np.ndarray, last: np.ndarray) -> None:
    """Print the mean improvement of a scheme, and the interval of that mean at 95 %."""
    values = first / last
    reach = half_width(values)
    low, high = values.mean(axis=0) - reach, values.mean(axis=0) + reach
    print(
        f'- {name}: '
        + ', '.join(
            f'{label} / {values[:, i].mean():.2f} ({low[i]:.2f} to {high[i]:.2f})'
            for label, i in (('tracking RMS X', X), ('Y', Y), ('contour RMS', CONTOUR))
        ),
        flush=True,
    )


def tables(title: str, gains: Gains, tuned: rig.Tuned, seeds: int) -> None:
    """Schemes 1 to 3 with one velocity feed-forward."""
    header(title)
    ours, printed = rig.designed(tuned), rig.printed(tuned)
    first = row('1, first lap', lambda seed: rig.learn(seed, gains, None, 1)[0][0], seeds)
    settled = row('1, lap 30', final(gains, None), seeds)
    row('2, iteration 30', final(gains, replace(ours, reinforced=False)), seeds)
    third = row('3, iteration 30', final(gains, ours), seeds)
    fixed = replace(printed, reinforced=False)
    row('2 as printed, best iteration', lambda seed: best(rig.learn(seed, gains, fixed)[0]), seeds)
    row('2 as printed, iteration 30', final(gains, fixed), seeds)
    plain = row('3 as printed, iteration 30', final(gains, printed), seeds)
    half = replace(fixed, gain=(0.5 * printed.gain[0], 0.5 * printed.gain[1]))
    row('2 as printed with half the rate', final(gains, half), seeds)
    print()
    ratios('3 against 1 (first lap)', first, third)
    ratios('3 against 1 (lap 30)', settled, third)
    ratios('3 as printed against 1 (first lap)', first, plain)
    ratios('3 as printed against 1 (lap 30)', settled, plain)


def best(results: list[Figures]) -> Figures:
    """Iteration with the smallest tracking RMS."""
    return min(results, key=lambda f: f.x.rms + f.y.rms)


def peers(tuned: rig.Tuned, seeds: int) -> None:
    """What a user would pick instead."""
    header('Peers: P + velocity and acceleration feed-forward; norm-optimal ILC on top of it')
    row('P + feed-forward', lambda s: rig.learn(s, tuned.feed_forward, None, 1)[0][0], seeds)
    weight = rig.change_weight(tuned.feed_forward)
    row(
        f'norm-optimal ILC (w_d {weight:g}), iteration 30',
        lambda s: rig.norm_optimal(s, tuned.feed_forward, weight)[-1],
        seeds,
    )


def duel(tuned: rig.Tuned, seeds: int) -> None:
    """Scheme 3 against norm-optimal learning: contour RMS, and where which is better."""
    push = rig.pulse(len(rig.contour()))
    situations = {
        'as in the tables': rig.NORMAL,
        'no random force': rig.Situation(noise=0.0),
        'random force four times': rig.Situation(noise=4.0),
        'load of half the mass': rig.Situation(load=0.5),
        'load of the whole mass': rig.Situation(load=1.0),
        'pushed in iteration 9': rig.Situation(extra={8: push}),
    }
    usual = LearningSettings()
    protected = replace(rig.designed(tuned), divergence=usual.divergence, floor=usual.floor)
    patient = rig.change_weight(tuned.feed_forward)
    eager = rig.change_weight(tuned.feed_forward, 4)
    print(
        f'\nContour RMS over {seeds} machines, µm. Norm-optimal ILC with the w_d that is best in '
        f'iteration 30 ({patient:g}) and the one that is best in iteration 4 ({eager:g}), on the '
        'tuning machine. Differences are scheme 3 minus peer, paired, with their 95 % interval.\n'
    )
    print(f'| situation | iteration | 3 | {patient:g} | difference | {eager:g} | difference |')
    print('|---|---|---|---|---|---|---|')
    shown = (1, 2, 4, 10, 30)
    for name, situation in situations.items():

        def rms(results: list[Figures]) -> list[float]:
            return [1e6 * results[iteration - 1].contour.rms for iteration in shown]

        third = np.array(
            [
                rms(rig.learn(s, tuned.scheme_1, protected, situation=situation)[0])
                for s in range(seeds)
            ]
        )
        cells = [[f'{value:.2f}'] for value in third.mean(axis=0)]
        for weight in (patient, eager):
            peer = np.array(
                [
                    rms(rig.norm_optimal(s, tuned.feed_forward, weight, situation=situation))
                    for s in range(seeds)
                ]
            )
            middle, reach = (third - peer).mean(axis=0), half_width(third - peer)
            for index, value in enumerate(peer.mean(axis=0)):
                low, high = middle[index] - reach[index], middle[index] + reach[index]
                cells[index] += [
                    f'{value:.2f}',
                    f'{middle[index]:+.2f} ({low:+.2f} to {high:+.2f})',
                ]
        for iteration, columns in zip(shown, cells, strict=True):
            print(f'| {name} | {iteration} | {" | ".join(columns)} |', flush=True)


def readings(tuned: rig.Tuned, seeds: int) -> None:
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
        row(name, final(gains, None), seeds)
    for reading in ('literal', 'recommended'):
        learning = replace(rig.printed(tuned), reading=reading)
        row(f'regulator {reading}', final(tuned.scheme_1, learning), seeds)


def settings() -> None:
    """Print the settings that follow from the nominal twin alone."""
    base = Gains(position=(rig.position_gain('x'), rig.position_gain('y')))
    tuned = rig.Tuned(base, base, base)
    print('| axis | K_p, 1/s | max \\|S\\| | max \\|S\\| with K_p + 1 |')
    print('|---|---|---|---|')
    for axis, gain in zip('xy', base.position, strict=True):
        largest = ' | '.join(f'{rig.sensitivity(axis, k):.4f}' for k in (gain, gain + 1.0))
        print(f'| {axis} | {gain:g} | {largest} |')
    ours, printed = rig.designed(tuned), rig.printed(tuned)
    print('\n| scheme 3 | cutoff of Q, Hz | lead, ticks | L_initial, 1/s |')
    print('|---|---|---|---|')
    for name, learning in (('by `ilc.design`', ours), ('as printed', printed)):
        print(f'| {name} | {learning.cutoff:g} | {learning.lead} | {learning.gain[0]:g} |')


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--seeds', type=int, default=5, help='machines per row')
    parser.add_argument('--settings', action='store_true', help='only what needs no machine')
    parser.add_argument('--readings', action='store_true', help='only the table of readings')
    parser.add_argument('--peers', action='store_true', help='only scheme 3 against its peer')
    given = parser.parse_args()
    if given.settings:
        settings()
        return
    begin = time.perf_counter()
    tuned = rig.tune()
    ours, printed = rig.designed(tuned), rig.printed(tuned)
    assert tuned.scheme_1.cmac is not None
    print(
        f'K_p {tuned.base.position} 1/s (max |S| {rig.SENSITIVITY}), K_c '
        f'{tuned.scheme_1.cross_coupling:g} 1/s, CMAC rate {tuned.scheme_1.cmac.rate:g} 1/s^2, '
        f'lead {ours.lead} ticks, Q {ours.cutoff:g} Hz, L_initial {ours.gain[0]:g} 1/s; without '
        f'lead Q {printed.cutoff:g} Hz, L_initial {printed.gain[0]:g} 1/s; K_a of the peer '
        f'{tuned.feed_forward.acceleration_feedforward[0]:g} s; circle of {rig.RADIUS} m at '
        f'{rig.FEED} m/s; means over {given.seeds} machines, µm; std of X RMS and contour RMS'
    )
    if given.readings:
        readings(tuned, given.seeds)
    elif given.peers:
        duel(tuned, given.seeds)
    else:
        print(
            'paper (X RMS, Y RMS, contour RMS): '
            + '; '.join(f'{name} {x} {y} {c}' for name, (x, y, c) in PAPER.items())
        )
        none = replace(tuned.scheme_1, velocity_feedforward=(0.0, 0.0))
        tables(
            'K_f = 0: the tracking error is the lag v / K_p, as its size in the paper says',
            none,
            tuned,
            given.seeds,
        )
        tables('K_f = 1: eq. 24 as written', tuned.scheme_1, tuned, given.seeds)
        peers(tuned, given.seeds)
    print(f'\n{time.perf_counter() - begin:.0f} s')


if __name__ == '__main__':
    main()
