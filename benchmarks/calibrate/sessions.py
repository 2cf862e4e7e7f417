"""Development sessions with their truth, from three machines that share no code."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.blind import cases as blind
from benchmarks.blind.machine import NOMINAL
from benchmarks.blind.plant import SUBSTEPS
from benchmarks.blind.session import as_session, run_machine, visible
from benchmarks.blind.suites import case
from benchmarks.generators import cases
from benchmarks.generators.__main__ import generator_of
from session_bags.reader import read_session
from stage_core.quantities import UNKNOWN, split_effect
from stage_core.session import Session
from stage_core.twin_file import TwinFile

GENERATORS = ('own', 'mujoco', 'handmade')
#: Cases of one seed, drawn together so that their kinds and effects are spread.
PER_SEED = 4
#: Seeds from here on are kept for reports.
REPORTED = 100

Truth = dict[str, Any]


@dataclass(frozen=True)
class Sample:
    """A session, the nominal twin, and the truth in the form of the generators' `truth.json`."""

    name: str
    session: Session
    twin: TwinFile
    truth: Truth


def samples(generator: str, seed: int) -> Iterator[Sample]:
    """The sessions of one seed of a generator.

    Raises
    ------
    ValueError
        If the seed is kept for reports.
    """
    if not 0 < seed < REPORTED:
        raise ValueError(f'seed {seed}: development seeds are 1 to {REPORTED - 1}')
    return _own(seed) if generator == 'own' else _others(generator, seed)


def _own(seed: int) -> Iterator[Sample]:
    for number in range(PER_SEED * (seed - 1), PER_SEED * seed):
        one = visible(case('main', number, 'development'))
        made = as_session(run_machine(one), one.seed, one.tracker, one.temperature)
        yield Sample(one.folder, made, TwinFile.from_dict(NOMINAL), own_truth(one))


def _others(generator: str, seed: int) -> Iterator[Sample]:
    for one in cases.draw_cases(generator_of(generator), seed, PER_SEED):
        with tempfile.TemporaryDirectory() as folder:
            cases.write_case(one, Path(folder))
            session = read_session(Path(folder) / 'bag')
            twin = TwinFile.load(Path(folder) / 'twin.yaml')
        yield Sample(one.name, session, twin, cases.truth(one))


#: Mechanisms of the blind suite that an effect describes, and whether it leaves some of them: a
#: bump of the force is finer than the knots of its curve.
SAYABLE = {
    'hidden_bump': ('position_force', True),
    'hidden_grating': ('cyclic_pitch_error', False),
}


def own_truth(one: blind.Case) -> Truth:
    """The truth of a case of the blind suite as `truth.json` of the generators has it."""
    return {
        'kind': one.kind,
        'truth': list(one.expected),
        'also_right': _also_right(one),
        'planted': [{'name': n, 'parameters': _made(v)} for n, v in one.truth.items()],
    }


def _also_right(one: blind.Case) -> list[list[str]]:
    """Effects below the noise; one for the mechanism outside, or for two that add up to it."""
    below = sorted(set(one.truth) - set(one.planted))
    ways = [{*one.expected, *below}] if below else []
    for effect, axis in (split_effect(n) for n in one.planted):
        said, leaves = SAYABLE.get(effect, ('', False))
        if said and (name := f'{said}.{axis}') not in one.planted:
            ways.append({*one.expected, name} - {UNKNOWN})
            ways += [{*one.expected, name}] if leaves else []
        pair = {f'coulomb_friction.{axis}', f'force_offset.{axis}'}
        if effect == 'force_offset' and pair <= set(one.planted):
            ways.append({*one.expected, f'asymmetric_friction.{axis}'} - pair)
    return [sorted(way) for way in ways]


def _made(values: dict[str, float]) -> dict[str, float]:
    """Parameters as a report means them: whole steps of delay, an offset that pushes forward."""
    step = NOMINAL['control_period'] / SUBSTEPS
    made = {'delay': lambda v: round(v / step) * step, 'offset': lambda v: -v}
    return {k: made[k](v) if k in made else v for k, v in values.items()}
