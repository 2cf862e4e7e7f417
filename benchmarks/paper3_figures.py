"""Figures 9 and 10 of paper 3 on the servo twin.

python benchmarks/paper3_figures.py [--out docs/images]
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import matplotlib

matplotlib.use('Agg')
import matplotlib.pyplot as plt
import numpy as np
import paper3_rig as rig

from contour_ctrl.figures import Figures

DISTURBED = 6


def x_rms(results: list[Figures]) -> np.ndarray:
    """Tracking RMS of X per iteration [µm]."""
    return np.array([1e6 * f.x.rms for f in results])


def main() -> None:
    """Draw both figures and print what they show."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--out', type=Path, default=Path('docs/images'))
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    tuned = rig.tune()
    gains = replace(tuned.scheme_1, velocity_feedforward=(0.0, 0.0))
    fuzzy = rig.printed(tuned)
    fixed = replace(fuzzy, reinforced=False)
    second, _, _ = rig.learn(0, gains, fixed)
    third, learner, controller = rig.learn(0, gains, fuzzy)
    assert learner is not None
    print('figure 9, X RMS µm, scheme 2:', np.round(x_rms(second), 2))
    print('figure 9, X RMS µm, scheme 3:', np.round(x_rms(third), 2))
    number = np.arange(1, rig.ITERATIONS + 1)
    figure, axes = plt.subplots(1, 2, figsize=(10, 3.8))
    axes[0].semilogy(number, x_rms(second), 'o-', label='scheme 2: fixed learning rate')
    axes[0].semilogy(number, x_rms(third), 's-', label='scheme 3: fuzzy regulator')
    axes[0].set(xlabel='iteration', ylabel='X tracking RMS [µm]')
    axes[0].legend()
    axes[1].step(number[:-1], [f[0] for f in learner.factors], where='mid')
    axes[1].set(xlabel='iteration', ylabel='learning rate / L_initial', ylim=(0, 1.05))
    save(figure, given.out / 'paper3_figure_9.png')

    pulse = rig.pulse(len(controller))
    disturbed, reacting, _ = rig.learn(
        0, gains, fuzzy, 16, rig.Situation(extra={DISTURBED - 1: pulse})
    )
    assert reacting is not None
    factors = np.array([f[0] for f in reacting.factors])
    print('figure 10, X RMS µm:', np.round(x_rms(disturbed), 2))
    print('figure 10, rate after each iteration:', np.round(factors, 2))
    number = np.arange(1, len(disturbed) + 1)
    figure, axes = plt.subplots(1, 2, figsize=(10, 3.8))
    axes[0].semilogy(number, x_rms(disturbed), 'o-')
    axes[0].axvline(DISTURBED, color='0.7', linestyle='--')
    axes[0].set(xlabel='iteration', ylabel='X tracking RMS [µm]', title='disturbance in 6')
    axes[1].step(number[:-1], factors, where='mid')
    axes[1].set(xlabel='iteration', ylabel='learning rate / L_initial', ylim=(0, 1.05))
    save(figure, given.out / 'paper3_figure_10.png')


def save(figure: plt.Figure, path: Path) -> None:
    """Write and close a figure."""
    figure.tight_layout()
    figure.savefig(path, dpi=90)
    plt.close(figure)
    print(f'wrote {path}')


if __name__ == '__main__':
    main()
