"""Picture of what paper 4 is about: the digits of the solver, and the error of the curve.

python benchmarks/paper4_figure.py [--out docs/images]
"""

from __future__ import annotations

import argparse
from pathlib import Path

from matplotlib.figure import Figure

from hra_curves.tables import MICRO, interval_errors, table1
from stage_core.drawing import canvas, styled

SIZES = (5, 10, 15, 20, 25, 30, 40, 50, 70, 100)
COUNTS = tuple(range(5, 22))
METHODS = {'linear': 'polyline', 'CAM': 'cubic spline', 'IB2': 'IB2', 'IB1': 'IB1'}


@styled
def draw() -> Figure:
    """Relative error of the solution over the size, and error of the cycloid over the points."""
    figure = canvas(10.5, 3.8)
    left, right = figure.subplots(1, 2)
    entries = table1(SIZES)
    for method in ('plain solve', 'HRA'):
        left.semilogy(SIZES, [e.here for e in entries if e.column == method], 'o-', label=method)
    left.set(xlabel='points', ylabel='relative error', title='control points, random data')
    left.legend()
    for method, label in METHODS.items():
        errors = [MICRO * max(interval_errors(method, n, range(n - 1))) for n in COUNTS]
        right.semilogy(COUNTS, errors, 'o-', ms=4, label=label)
    right.set(xlabel='points', ylabel='largest error (µm)', title='curve through a cycloid')
    right.legend()
    return figure


def main() -> None:
    """Draw the picture."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--out', type=Path, default=Path('docs/images'))
    place = parser.parse_args().out / 'paper4.webp'
    draw().savefig(place, dpi=90, facecolor='white', pil_kwargs={'quality': 70})
    print(f'wrote {place}')


if __name__ == '__main__':
    main()
