"""Command line: ``python -m hra_curves table1|table3|table4|table5|worth``."""

from __future__ import annotations

import argparse
import sys

from hra_curves import tables, worth
from hra_curves.printing import format_entries, format_number, format_table
from stage_core.errors import StageError, command_line


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
    print('\nThe place of the nodes in the domain of the basis')
    print(format_entries(tables.node_conventions()))
    print('\nSection 6.1: points needed')
    print(format_entries(tables.counts()))


def _table4() -> None:
    print('Table 4: largest least-squares errors of the cycloid at the control points printed')
    print(format_entries(tables.table4()))
    print('\nControl points needed for 0.05 um')
    print(format_entries(tables.table4_counts()))


def _table5() -> None:
    print('Table 5: errors (um) at points of the cycloid through 11 data, U = 0.50 um (k = 2)')
    rows = [
        [
            row.name,
            f'{row.system_error * 1e6:.2f} +- {row.system_deviation * 1e6:.2f}',
            row.paper_trajectory,
            format_number(row.trajectory * 1e6),
            f'{row.total * 1e6:.2f}',
            f'{100.0 * row.share:.1f} %',
        ]
        for row in worth.table5()
    ]
    print(
        format_table(
            ['point', 'stage', 'definition, paper', 'definition, here', 'total', 'share'], rows
        )
    )
    print('share: of the squared definition error in the mean squared total error.')
    print('The paper does not say where its points lie; here at 0.5 and 0.6 of the first')
    print('interval, 0.35 and 0.45 of the second, and the CAM figures depend on that.')


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
    commands.add_parser('table5', help='share of the definition error in the total')
    commands.add_parser('worth', help='what the accuracy and the basis are each worth')
    chosen = parser.parse_args(arguments)
    if chosen.command == 'table1':
        _table1(chosen.sizes)
    else:
        {'table3': _table3, 'table4': _table4, 'table5': _table5, 'worth': _worth}[
            chosen.command
        ]()
    return 0


if __name__ == '__main__':
    sys.exit(main())
