"""``ros2 run calibrator retrain_offline``: train a model from bags alone and say what it gains."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from calibrator import model_file
from calibrator.compare import compare, table
from calibrator.gather import gather, read_training_session
from calibrator.models import METHODS
from calibrator.phase_table import PhaseTable
from calibrator.prepare import INPUTS, TARGETS, prepare
from calibrator.restarts import train_restarts
from calibrator.samples import Samples
from calibrator.training import Training, default_options, judged_by, predict, train
from calibrator.training_job import Job, run_job
from session_bags.archive import add_arguments, find_bags, where_from
from stage_core.errors import StageError, command_line
from stage_core.metrics import Metrics
from stage_core.untrusted import json_object


@command_line
def main(arguments: Sequence[str] | None = None) -> int:
    """Train, print the errors before and after, and write the model."""
    options = _parser().parse_args(arguments)
    folder = Path(options.out).parent
    if not folder.is_dir():
        raise StageError(f'{options.out}: there is no folder {folder}: create it first')
    where = where_from(options, progress=sys.stderr.isatty())
    gathered = gather(options.bag, options.input, options.target, options.results, where)
    samples = gathered.samples
    for bag, reason in gathered.skipped.items():
        print(f'skipped {bag}: {reason}', file=sys.stderr)
    kind = 'rests' if samples.at_rest else 'moving points'
    print(
        f'{len(samples)} {kind} of {len(gathered.bags)} bag(s), axes {"".join(samples.axes)}, '
        f'tracker {1e3 * samples.shift:.2f} ms behind the commands, servo lag included'
    )
    if options.compare:
        shared = {m: default_options(m, gathered.leads) for m in METHODS}
        print(table(compare(samples, options=shared, seed=options.seed, by=options.split)))
        return 0
    job = _job(options)
    held = _held_out(options, samples)

    def trained(settings: dict[str, Any]) -> Training:
        if options.restarts <= 1:
            return train(samples, job.method, settings, job.seed, job.by, _progress())
        result, values = train_restarts(
            samples, job.method, settings, job.seed, job.by, options.restarts, options.results,
            where,
        )  # fmt: skip
        listed = ' '.join(f'{1e6 * value:.4f}' for value in values)
        print(f'training RMS from {len(values)} starts [µm]: {listed}; the least is taken')
        return result

    def judged(settings: dict[str, Any]) -> Training:
        result = trained(settings)
        if not held:
            return result
        print(_held_out_table(held, samples, result, options.phase_table))
        return judged_by(result, [part for _, part in held], job.seed)

    result, model = run_job(job, gathered, training=judged)
    print(result.model.describe())
    print(before_and_after(result.before, result.after, result.held_out))
    print(result.line())
    print(f'domain: {model.domain_line()}')
    if options.out:
        model_file.save(model, options.out)
        marked = ', marked as refused: ~/activate will not take it' if model.refusal else ''
        print(f'model written to {options.out}{marked}')
    return 0


def _job(options: argparse.Namespace) -> Job:
    return Job(
        out=options.out,
        bags=options.bag,
        method=options.method,
        options=json_object(options.options, '--options', 'write {"degree": 7}, for example'),
        source=options.input,
        target=options.target,
        by=options.split,
        machine=options.machine,
        seed=options.seed,
        max_correction=options.max_correction,
        force=options.force,
    )


def before_and_after(before: Metrics, after: Metrics, count: int) -> str:
    """Table of the four metrics in micrometres."""
    lines = [f'{"held-out " + str(count) + " [µm]":22s} {"before":>10s} {"after":>10s}']
    for name, label in (('rms', 'RMS'), ('mae', 'MAE'), ('max', 'max'), ('sigma', 'sigma')):
        lines.append(
            f'{label:22s} {1e6 * getattr(before, name):10.3f} {1e6 * getattr(after, name):10.3f}'
        )
    return '\n'.join(lines)


def _held_out(options: argparse.Namespace, samples: Samples) -> list[tuple[str, Samples]]:
    """Names and samples of the bags that are held out of a training on `samples`."""
    bags = [bag for path in options.holdout for bag in find_bags(path)]
    held = [(bag.name, _samples(bag, options)) for bag in bags]
    for name, part in held:
        if part.axes != samples.axes:
            raise StageError(
                f'{name} has the axes {"".join(part.axes)}, the training {"".join(samples.axes)}: '
                'hold out a session of the same axes'
            )
        if samples.holds(part):
            raise StageError(f'{name} was trained on: hold out another session')
    return held


def _samples(bag: Path, options: argparse.Namespace) -> Samples:
    session = read_training_session(bag, options.input, options.target)
    return prepare(session, options.input, options.target)


def _held_out_table(
    bags: list[tuple[str, Samples]], samples: Samples, result: Training, phase_table: bool
) -> str:
    """RMS per held-out bag and axis: uncalibrated, phase table where asked for, model."""
    model = result.model
    predictors: dict[str, Callable[[Samples], Any]] = {'before': lambda s: s.command}
    if phase_table:
        baseline = PhaseTable().fit(samples.command, samples.measured)
        predictors['phase table'] = lambda s: baseline.predict(s.command)
    predictors[model.method] = lambda s: predict(model, s)
    lines = [f'{"held-out RMS [µm]":22s} ' + ' '.join(f'{name:>12s}' for name in predictors)]
    for name, seen in bags:
        held = seen.only(result.sensors)
        errors = [
            np.sqrt(np.mean((held.measured - predict(held)) ** 2, axis=0))
            for predict in predictors.values()
        ]
        for number, axis in enumerate(held.axes):
            cells = ' '.join(f'{1e6 * error[number]:12.1f}' for error in errors)
            lines.append(f'{name + " " + axis:22s} {cells}')
    return '\n'.join(lines)


def _progress() -> Any:
    """A line that counts iterations, on a terminal only."""
    if not sys.stderr.isatty():
        return None

    def show(iteration: int, best: float) -> None:
        print(f'\riteration {iteration}, error {best:.5g} ', end='', file=sys.stderr, flush=True)

    return show


def _not_negative(kind: Callable[[str], Any]) -> Callable[[str], Any]:
    """Reads a number that is finite and not negative."""

    def number(text: str) -> Any:
        value = kind(text)
        if not 0 <= value < float('inf'):
            raise argparse.ArgumentTypeError(f'{text} is not a finite number from 0 on')
        return value

    return number


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog='retrain_offline', description=__doc__)
    parser.add_argument(
        '--bag',
        action='append',
        required=True,
        help='session bag, repeatable; or a folder of them, whose bad bags are skipped',
    )
    parser.add_argument('--method', default='structured', choices=list(METHODS))
    parser.add_argument('--options', default='{}', help='options of the method, a JSON object')
    parser.add_argument('--input', default='reference', choices=INPUTS, help='model input')
    parser.add_argument('--target', default='tracker', choices=TARGETS, help='model output')
    parser.add_argument('--split', default='position', choices=('position', 'time'))
    parser.add_argument('--holdout', action='append', default=[], help='bag that must gain, too')
    parser.add_argument(
        '--phase-table', action='store_true', help='with --holdout: beside a table over the lap'
    )
    parser.add_argument('--compare', action='store_true', help='table of all methods, no model')
    parser.add_argument('--machine', default='', help='name of the stage, kept in the model')
    parser.add_argument('--seed', type=_not_negative(int), default=0)
    parser.add_argument('--out', default='', help='model file to write')
    parser.add_argument(
        '--max-correction',
        type=_not_negative(float),
        default=Job.max_correction,
        help='largest correction, and largest error left [m]',
    )
    parser.add_argument(
        '--force', action='store_true', help='write a model that is no better than none, marked'
    )
    parser.add_argument(
        '--restarts',
        type=_not_negative(int),
        default=1,
        help='random starts of a swarm; the best is taken',
    )
    parser.add_argument(
        '--results',
        default='bags/retrain_results',
        help='folder that keeps what each bag and start gave, so that a run can be resumed',
    )
    add_arguments(parser)
    return parser


if __name__ == '__main__':
    sys.exit(main())
