"""Paper 5: the weights of eq. 11, and examples I and II.

python benchmarks/paper5_examples.py
"""

import sys

import numpy as np

from calibrator.kinematic import Poses, grow_calibration
from calibrator.lolimot import LocalLinearTree, grow


def poses(delta, noise: float) -> Poses:
    """Two hundred poses of the mechanism with x_P = 0.2 m, y_P = 0 and l = 1 m."""
    generator = np.random.default_rng(0)
    s, angle = generator.uniform(0.0, 1.0, 200), generator.uniform(-1.2, 1.2, 200)
    x = 0.2 + s + np.cos(angle) + generator.normal(0.0, noise, 200)
    return Poses(s, angle, x, delta(s) + np.sin(angle) + generator.normal(0.0, noise, 200))


def main() -> int:
    """Print ours beside the paper's."""
    u = np.linspace(0.0, 1.0, 2001)
    trees = grow(u[:, None], 0.03 * np.exp(-2.0 * u), models=3, overlap=0.1, penalty=None)
    print('eq. 11, rows [slope offset]; (11a) and (11b) print the first rows of (11c)')
    for name, tree in zip('abc', trees, strict=True):
        rows = '; '.join(f'{w[1]:.4f} {w[0]:.4f}' for w in tree.weights)
        print(f'  ours (11{name}): [{rows}]')
    print('  paper (11c): [-0.0470 0.0295; -0.0285 0.0250; -0.0137 0.0173]')
    weights = np.array([[0.0295, -0.0470], [0.0250, -0.0285], [0.0173, -0.0137]])
    planted = LocalLinearTree(trees[-1].low, trees[-1].high, weights, 0.1)
    steps = grow_calibration(poses(lambda s: planted.predict(s[:, None]), 0.0))
    print('example I, e of eq. 12:', ', '.join(f'{m.discrepancy:.2e}' for m in steps))
    print('  paper (15b): 7.84e-02, 4.05e-04, 1.53e-07')
    print(f'  largest error of w {np.abs(steps[-1].guide.weights - weights).max():.1e}, of l '
          f'{abs(steps[-1].length - 1.0):.1e}, of x_P {abs(steps[-1].x_p - 0.2):.1e}')  # fmt: skip
    steps = grow_calibration(poses(lambda s: 0.03 * np.exp(-2.0 * s), 2e-4))
    rows = '; '.join(f'{w[1]:.4f} {w[0]:.4f}' for w in steps[-1].guide.weights)
    print(f'example II, noise 0.2 mm: {len(steps)} models [{rows}], l {steps[-1].length:.6f} m')
    print('  paper (16): [-0.0473 0.0296; -0.0272 0.0247; -0.0129 0.0167], l 1 m')
    return 0


if __name__ == '__main__':
    sys.exit(main())
