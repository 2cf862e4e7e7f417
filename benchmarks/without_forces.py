"""Blind sessions without recorded effort, and a twin file without gains.

    python -m benchmarks.without_forces --cases 40 --out build/without_forces

The machines are those of the suite `main` of the blind check, with its report seeds. What a
session without forces cannot tell (`NOT_TOLD`, and viscous friction that another mass would have,
too) is not asked for: it may be passed over, or leave `unknown`. A run that was stopped goes on.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from benchmarks.blind.machine import NOMINAL
from benchmarks.blind.session import as_session, run_machine, visible
from benchmarks.blind.suites import case
from benchmarks.rows import cases, commit
from gap_diagnosis.diagnose import diagnose
from gap_diagnosis.residuals.without_forces import NOT_TOLD
from stage_core import topics
from stage_core.quantities import UNKNOWN, split_effect
from stage_core.session import Session
from stage_core.twin_file import GAINS, TwinFile

OPTIONAL = {*NOT_TOLD, 'viscous_friction'}
#: Of an asymmetric friction without its mean level the difference of the levels is left.
LEFT_OF = {'asymmetric_friction': 'coulomb_friction'}


def without_gains(content: dict[str, Any]) -> dict[str, Any]:
    """The content of a twin file with nothing of its controller."""
    unstated = (*GAINS, 'velocity_feedforward', 'delay')
    axes = {
        name: {k: v for k, v in axis.items() if k not in unstated}
        for name, axis in content['axes'].items()
    }
    return {**content, 'axes': axes}


def mute(session: Session) -> Session:
    """The session of a drive that does not tell its force."""
    command = session.series[topics.COMMAND]
    values = {k: v for k, v in command.values.items() if not k.startswith('effort')}
    return replace(
        session, series={**session.series, topics.COMMAND: replace(command, values=values)}
    )


def run_case(number: int) -> dict[str, Any]:
    """What is planted in a case, and what a diagnosis without forces says."""
    one = visible(case('main', number, 'report'))
    session = mute(as_session(run_machine(one), one.seed, one.tracker, one.temperature))
    found = diagnose([session], [], TwinFile.from_dict(without_gains(NOMINAL)))
    return {'number': number, 'expected': list(one.expected), 'verdict': found.verdict}


def judged(row: dict[str, Any]) -> tuple[bool, list[str]]:
    """Whether a verdict is exact, and its false names."""
    expected = set(row['expected'])
    optional = {n for n in expected if split_effect(n)[0] in OPTIONAL}
    may = expected | {UNKNOWN} if optional else expected
    left = {n.replace(a, b) for n in expected for a, b in LEFT_OF.items() if n.startswith(a)}
    said = set(row['verdict'])
    exact = expected - optional <= said <= may | left
    return exact, sorted(said - expected - left - {UNKNOWN})


def table(rows: Sequence[dict[str, Any]]) -> str:
    """Shares of exact verdicts and of sessions with a false name."""
    scores = [judged(row) for row in rows]
    exact, false = (sum(bool(s[i]) for s in scores) for i in (0, 1))
    masses = sum(any(n.startswith('inertia') for n in row['verdict']) for row in rows)
    return (
        f'{len(rows)} sessions: {exact} exact, {false} with a false name, {masses} with a mass\n'
        f'code {commit()}'
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--cases', type=int, default=40)
    parser.add_argument('--out', type=Path, default=Path('build/without_forces'))
    options = parser.parse_args(arguments)
    rows = cases(options.out, range(options.cases), run_case)
    print(table(rows))
    return 0


if __name__ == '__main__':
    sys.exit(main())
