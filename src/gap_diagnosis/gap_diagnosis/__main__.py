"""Command line: ``python -m gap_diagnosis diagnose --bag BAG --twin TWIN --out DIR``."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from gap_diagnosis.archive import diagnose_archive
from gap_diagnosis.experiment.travel import travel_of
from gap_diagnosis.service import run
from session_bags.archive import add_arguments, is_bag, where_from
from stage_core.errors import StageError, command_line


@command_line
def main(arguments: Sequence[str] | None = None) -> int:
    """Diagnose sessions and write the report; exit status 2 for input that cannot be."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    # `ros2 run gap_diagnosis diagnose --bag …` names the command by the executable.
    if words[:1] == ['diagnose']:
        words = words[1:]
    options = _parser().parse_args(words)
    if options.seed < 0:
        raise StageError(f'--seed {options.seed}: give a whole number from 0 on')
    travel = travel_of(options.travel)
    folders = [path for path in options.bag if Path(path).is_dir() and not is_bag(path)]
    if folders:
        if len(options.bag) > 1 or options.holdout or options.controller or options.sim_bag:
            raise StageError(
                f'{folders[0]} is a folder of bags, each diagnosed by itself: give it alone, '
                'without another --bag, --holdout, --controller or --sim-bag'
            )
        how = {
            'seed': options.seed,
            'without': options.without,
            'with_page': not options.no_page,
            'travel': travel,
        }
        where = where_from(options, progress=not options.quiet)
        print(diagnose_archive(folders[0], options.twin, Path(options.out), how, where))
        return 0
    verdict = run(
        options.bag,
        options.holdout,
        options.twin,
        Path(options.out),
        seed=options.seed,
        quiet=options.quiet,
        without=options.without,
        with_page=not options.no_page,
        controller=options.controller,
        sim_bags=options.sim_bag,
        travel=travel,
    )
    print(verdict)
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog='gap_diagnosis diagnose',
        description='Where the gap between sessions and their twin lies, which effect causes it, '
        'and how far it shrinks with that effect in the twin.',
    )
    parser.add_argument(
        '--bag',
        action='append',
        required=True,
        help='session bag, repeatable; or one folder of bags, each diagnosed by itself',
    )
    parser.add_argument(
        '--holdout', action='append', default=[], help='held-out session bag, repeatable'
    )
    parser.add_argument(
        '--twin', required=True, help='twin file of the nominal machine, or a model (MJCF, URDF)'
    )
    parser.add_argument(
        '--controller', help='twin file of the controller, where --twin is a model'
    )
    parser.add_argument(
        '--sim-bag',
        action='append',
        default=[],
        help="a simulator's run of the same command, in place of the twin's prediction; one for "
        'each --bag and --holdout',
    )
    parser.add_argument('--out', required=True, help='directory for the report')
    parser.add_argument('--seed', type=int, default=0, help='of bootstrap and permutations')
    parser.add_argument('--quiet', action='store_true', help='no progress on stderr')
    parser.add_argument(
        '--without',
        action='append',
        default=[],
        metavar='EFFECT',
        help='take an effect out of the library (backlash, or backlash.x), repeatable',
    )
    parser.add_argument(
        '--no-page', action='store_true', help='write report.json and the twin, no report.html'
    )
    parser.add_argument(
        '--travel',
        action='append',
        default=[],
        metavar='AXIS:LOW:HIGH',
        help='what the experiment may use of an axis in metres, as x:-0.05:0.05; default: the '
        'travel of the session',
    )
    add_arguments(parser)
    return parser


if __name__ == '__main__':
    sys.exit(main())
