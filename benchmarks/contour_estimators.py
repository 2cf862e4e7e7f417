"""Error of each contour error estimate on each test curve, against the converged closest point.

python benchmarks/contour_estimators.py
"""

from __future__ import annotations

import numpy as np

from contour_ctrl import contour_error, curves, nurbs, reference
from contour_ctrl.feedrate import AxisLimits
from contour_ctrl.path import PathTable
from hra_curves.arc_length import ArcLength, Curve

CURVES: dict[str, Curve] = {
    'circle 20 mm': curves.circle(0.02),
    'square, corners 5 mm': curves.square(0.04, 0.005),
    'star, corners 2 mm': curves.star(0.03, 0.015, 0.002),
    'eight 60 x 30 mm': curves.eight(0.06, 0.03),
    'free form, 7 points': nurbs.interpolate(
        [
            (0, 0),
            (0.02, -0.005),
            (0.04, 0.0),
            (0.05, 0.02),
            (0.03, 0.035),
            (0.01, 0.03),
            (-0.005, 0.015),
        ],
        closed=True,
    ),
}


def main() -> None:
    """Print the largest error of each estimate, and the fluctuation of the feed."""
    print('| curve | lag | tangent | osculating circle | 1 step | 2 steps | feed fluctuation |')
    print('|---|---|---|---|---|---|---|')
    limits = AxisLimits(jerk=(1e5, 1e5), acceleration=(50.0, 50.0))
    for name, curve in CURVES.items():
        arc = ArcLength.of(curve)
        path = PathTable.from_curve(arc)
        table = path.values, path.step, path.closed
        fluctuation = reference.plan(curve, 0.06, limits=limits).fluctuation
        for lag in (2e-4, 1e-3):
            s = np.linspace(0.0, arc.total, 1999, endpoint=False)
            place, tangent = curve.derivatives(arc.parameter(s - lag + (s < lag) * arc.total), 1)
            tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
            points = place + 3e-5 * np.column_stack([-tangent[:, 1], tangent[:, 0]])
            exact = contour_error.estimates(*table, s, points, 20)
            cells = [contour_error.estimates(*table, s, points, 0)]
            cells.append(
                np.array(
                    [
                        contour_error.osculating_estimate(*table, a, *p)
                        for a, p in zip(s, points, strict=True)
                    ]
                )
            )
            cells += [contour_error.estimates(*table, s, points, n) for n in (1, 2)]
            text = ' | '.join(f'{1e6 * np.abs(c - exact).max():.2g}' for c in cells)
            print(f'| {name} | {1e3 * lag:g} mm | {text} | {100 * fluctuation:.1e} % |')


if __name__ == '__main__':
    main()
