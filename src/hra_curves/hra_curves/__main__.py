"""Command line: ``python -m hra_curves table1|table3|table4|table5|worth``."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from hra_curves import readings, tables, twin_share, worth
from hra_curves.printing import format_entries, format_number, format_table
from stage_core.errors import StageError, command_line
from stage_core.twin_file import TwinFile


def _table1(sizes: str | None) -> None:
    print('Table 1: relative error of the solution of A x = c, median of 5 random c')
    if sizes is None:
        print(format_entries(tables.table1()))
        return
    try:
        chosen = [int(size) for size in sizes.split(',')]
    except ValueError:
        chosen = []
    if not chosen or min(chosen) < 2 or max(chosen) > 400:
        raise StageError(f'sizes {sizes!r}: give whole numbers from 2 to 400, as 10,20')
    print(format_entries(tables.table1(chosen)))


def _table3() -> None:
    print('Table 3: largest interpolation errors of the cycloid (r = 1 mm)')
    print(format_entries(tables.table3()))
    print('\nOther readings tried')
    print(format_entries(readings.other_readings()))
    print('\nThe place of the nodes in the domain of the basis')
    print(format_entries(tables.node_conventions()))
    print('\nSection 6.1: points needed')
    print(format_entries(tables.counts()))


def _table4() -> None:
    print('Table 4: largest least-squares errors of the cycloid at the control points printed')
    print(format_entries(tables.table4()))
    print('\nControl points needed for 0.05 µm')
    print(format_entries(tables.table4_counts()))


def _difference(row: twin_share.Hold) -> str:
    if row.paper is None:
        return 'not in the paper'
    if row.method == 'CAM' and row.name in ('TP1', 'TP2'):
        return 'CAM of TP1 and TP2 likely exchanged'
    return "stage: the paper's loop corrects the resolution"


def _table5(twin_file: str | None) -> None:
    path = twin_share.default_twin() if twin_file is None else twin_file
    twin = TwinFile.load(path)
    uncertainty = twin_share.measured_uncertainty(twin)
    holds, drives = twin_share.table5(twin)
    print('Table 5: share of the definition error in the total, cycloid through 11 data')
    print(
        f'twin {Path(path).name}: U (k = 2) measured over 50 mm x 50 mm: '
        f'x {uncertainty[0] * 1e6:.2f} µm, y {uncertainty[1] * 1e6:.2f} µm (paper 0.50 µm)'
    )
    print('\nHeld at a point of the curve (µm)')
    rows = [
        [
            f'{row.name} {"HRA IB1" if row.method == "IB1" else row.method}',
            row.paper.definition if row.paper else '',
            format_number(row.definition * 1e6),
            f'{row.paper.system:.2f} ± {row.paper.deviation:.2f}' if row.paper else '',
            f'{row.system * 1e6:.2f} ± {row.deviation * 1e6:.2f}',
            f'{row.total * 1e6:.2f}',
            f'{100.0 * row.paper.share:.1f} %' if row.paper else '',
            f'{100.0 * row.share:.1f} %',
            _difference(row),
        ]
        for row in sorted(holds, key=lambda row: row.name)
    ]
    header = ['point', 'definition: paper', 'here', 'stage: paper', 'here', 'total rms']
    print(format_table([*header, 'share: paper', 'here', 'difference'], rows))
    print('\nDriven from end to end (µm, distance to the cycloid)')
    moving = [
        [
            row.method,
            format_number(row.largest_definition * 1e6),
            format_number(row.definition * 1e6),
            format_number(row.total * 1e6),
            f'{100.0 * row.share:.1f} %',
        ]
        for row in drives
    ]
    header = ['method', 'definition max', 'definition rms', 'total rms', 'share']
    print(format_table(header, moving))
    print('Stage: its error along the definition error, size of the mean of a hold ± deviation in')
    print('it, over 50 placings in the working range. Share: of the squared definition error in')
    print('the mean square of definition and stage together; that of the paper from its columns.')


def _worth() -> None:
    print('Where the accuracy, the basis or neither makes the difference')
    for row in worth.worth():
        cells = ', '.join(f'{name} {format_number(value)}' for name, value in row.results.items())
        print(f'{row.case} [{row.unit}]\n    {cells}')
        if row.winner:
            print(f'    smallest: {row.winner}')


@command_line
def main(arguments: list[str] | None = None) -> int:
    """Print one table."""
    parser = argparse.ArgumentParser(prog='python -m hra_curves', description=__doc__)
    commands = parser.add_subparsers(dest='command', required=True)
    first = commands.add_parser('table1', help='relative errors of the solvers')
    first.add_argument('--sizes', help='sizes n as 10,20,50 (default 10,20,25,50,100,200)')
    commands.add_parser('table3', help='interpolation of the cycloid')
    commands.add_parser('table4', help='least squares of the cycloid')
    fifth = commands.add_parser('table5', help='share of the definition error in the total')
    fifth.add_argument('--twin', help='twin file of the stage (default: the NanoPla of paper 4)')
    commands.add_parser('worth', help='what the accuracy and the basis are each worth')
    chosen = parser.parse_args(arguments)
    if chosen.command == 'table1':
        _table1(chosen.sizes)
    elif chosen.command == 'table5':
        _table5(chosen.twin)
    else:
        {'table3': _table3, 'table4': _table4, 'worth': _worth}[chosen.command]()
    return 0


if __name__ == '__main__':
    sys.exit(main())
