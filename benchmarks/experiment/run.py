"""How often the right name stands alone before and after one experiment.

    python -m benchmarks.experiment.run --first 0 --cases 42 --out build/experiment

Each case is a machine with one effect and a session of poor excitation (`machine.py`). Where the
diagnosis leaves a question open, the machine moves once more: with the designed experiment, and
with a sweep, a raster and a multisine of the same length within the same limits. Each time old
and new session are diagnosed together. A run that was stopped goes on where it was.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.experiment.machine import (
    MOTIONS,
    PERIOD,
    Case,
    draw,
    nominal,
    poor_motion,
    record,
)
from benchmarks.rows import cases, commit
from benchmarks.rows import table as markdown
from gap_diagnosis.diagnose import diagnose
from gap_diagnosis.experiment.motions import Limits, Motion, sample
from gap_diagnosis.experiment.propose import limits_of, propose
from gap_diagnosis.result import Diagnosis
from stage_core.arrays import Array
from stage_core.errors import StageError

TRAVEL = {'x': (-0.04, 0.04), 'y': (-0.04, 0.04)}
#: Of the experiment [s].
DURATION = 14.0
#: Size and speed of the standard motions, of the range that the experiment has too.
SIZE, SPEED = 0.9, 0.8
STANDARD = ('sweep', 'raster', 'multisine')
MOVED = ('experiment', *STANDARD)


def standard(kind: str, limits: Limits, duration: float) -> Array:
    """A standard motion of both axes in the middle of the travel."""
    return sample(Motion(kind, SIZE, SPEED, (0.5, 0.5), 3), limits, duration, PERIOD)


def answer(found: Diagnosis) -> dict[str, Any]:
    """What a diagnosis says."""
    named = {c.effect: c.alternatives for c in found.causes if c.status == 'accepted'}
    return {'verdict': found.verdict, 'alternatives': named}


def named(case: Case, said: dict[str, Any] | None) -> bool:
    """Whether the right name is there and no other one."""
    return said is not None and said['verdict'] == [case.effect]


def alone(case: Case, said: dict[str, Any] | None) -> bool:
    """Whether no rival stands beside it either."""
    return said is not None and named(case, said) and not said['alternatives'].get(case.effect)


def run_case(seed: int) -> dict[str, Any]:
    """Answers before and after each motion; no `after` where nothing is open."""
    case = draw(seed)
    first = record(case, poor_motion(case), seed, 'first')
    found = diagnose([first], [], nominal())
    out: dict[str, Any] = {'seed': seed, 'effect': case.effect, 'motion': case.motion}
    out |= {'before': answer(found), 'after': {}}
    experiment = propose(found, TRAVEL, DURATION)
    if experiment is None:
        return out
    out |= {'expected': experiment.expected, 'motions': experiment.motions}
    limits = limits_of(found, TRAVEL)
    motions = {'experiment': experiment.position}
    motions |= {k: standard(k, limits, experiment.duration) for k in STANDARD}
    for name, position in motions.items():
        second = record(case, np.asarray(position), seed + 500, name)
        try:
            out['after'][name] = answer(diagnose([first, second], [], nominal()))
        except StageError as error:
            out['after'][name] = None
            out.setdefault('errors', []).append(f'{name}: {error}')
    return out


def table(rows: list[dict[str, Any]]) -> str:
    """How often the right name stands alone: before, and after each motion.

    A session without a question stays as it is, whatever the motion.
    """
    drawn = [(draw(r['seed']), r) for r in rows]

    def counts(label: str, right: Callable[..., bool], motion: str = '') -> list[str]:
        own = [(c, r) for c, r in drawn if motion in ('', c.motion)]
        before = [right(c, r['before']) for c, r in own]
        after = [
            [right(c, r['after'].get(name) if r['after'] else r['before']) for c, r in own]
            for name in MOVED
        ]
        return [f'{label} ({len(own)})', *(str(sum(hits)) for hits in (before, *after))]

    asked = sum(bool(r['after']) for r in rows)
    head = [f'of {len(rows)} sessions, {asked} with a question', 'before', *MOVED]
    lines = [
        counts('the right name alone, no rival beside it', alone),
        *(counts(f'the same after `{motion}`', alone, motion) for motion in MOTIONS),
        counts('the right name and no other one, rivals aside', named),
    ]
    return markdown(head, lines)


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--first', type=int, default=0, help='seed of the first case')
    parser.add_argument('--cases', type=int, default=42)
    parser.add_argument('--out', type=Path, default=Path('build/experiment'))
    options = parser.parse_args(arguments)
    rows = cases(options.out, range(options.first, options.first + options.cases), run_case)
    print(f'code {commit()}\n\n{table(rows)}')
    return 0


if __name__ == '__main__':
    sys.exit(main())
