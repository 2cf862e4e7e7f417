"""Blind check of the law of the remainder; writes docs/results/law.md.

    python -m benchmarks.laws.run [--part effects|none|planted ...] [--seeds 1] [--sessions 100]

`effects`: an effect is taken out of the library with its relatives and has to come back as a law.
`none`: the search is let loose on residuals of the nominal machine, without the diagnosis' own
gate. `planted`: the ten laws of `planted.py` with the whole library.
"""

from __future__ import annotations

import argparse
import functools
import json
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.blind.cases import draw_single
from benchmarks.blind.machine import NOMINAL, Recording, moves, record
from benchmarks.blind.session import as_session, run_machine
from benchmarks.blind.suites import SAME
from benchmarks.laws import planted, written
from benchmarks.rows import kept
from gap_diagnosis.diagnose import diagnose
from gap_diagnosis.input.data import load_record
from gap_diagnosis.law.judged import law_of
from gap_diagnosis.law.learn import axis_problem
from gap_diagnosis.law.signals import error_signals, force_signals
from gap_diagnosis.residuals.kinematics import Kinematics
from gap_diagnosis.residuals.servo import Servo
from gap_diagnosis.result import Diagnosis
from stage_core.quantities import split_effect
from stage_core.session import Session
from stage_core.twin_file import TwinFile
from stage_twin.effects import EFFECTS as LIBRARY
from stage_twin.simulate import simulate

DURATION = 20.0  # s of a session
#: Effects that are functions of the basis, and what goes out of the library beside `SAME`.
EFFECTS: dict[str, tuple[str, ...]] = {
    'inertia_mismatch': ('torque_sag',),
    'viscous_friction': ('stribeck_friction', 'drive_gain'),
    'coulomb_friction': ('position_dependent_friction',),
    'asymmetric_friction': ('position_dependent_friction',),
    'stribeck_friction': ('position_dependent_friction',),
    'force_offset': ('position_force',),
    'force_ripple': ('position_force',),
    'cable_force': ('position_force',),
    'force_saturation': (),
    'drive_gain': ('torque_sag',),
    'position_force': ('cable_force', 'force_offset'),
    'position_dependent_friction': (
        'coulomb_friction', 'stribeck_friction', 'asymmetric_friction',
    ),
    'torque_sag': ('drive_gain',),
    'axis_crosstalk': (),
    'current_loop_lag': ('actuation_delay',),
    'scale_error': (),
    'cyclic_pitch_error': (),
    'straightness': (),
    'backlash': (),
    'thermal_expansion': (),
    'angular_error': (),
    'nonorthogonality': ('tracker_misalignment',),
    'tracker_misalignment': ('nonorthogonality', 'straightness'),
}  # fmt: skip
#: Effects that the blind machine lacks: of the twin, with these values.
OF_TWIN: dict[str, dict[str, float]] = {
    'position_force': {
        'start': -0.03, 'stop': 0.03,
        **{f'c{k}': v for k, v in enumerate((0, 4, 9, 12, 8, 1, -5, -8, -6))},
    },
    'position_dependent_friction': {
        'start': -0.03, 'stop': 0.03, 'presliding': 4e-6,
        **{f'c{k}': 6.0 + 1.5 * k for k in range(7)},
    },
    'torque_sag': {'sag_force': 2e-3, 'sag_speed': 1.0},
    'axis_crosstalk': {'mass': 2.0, 'viscous': 20.0},
    'current_loop_lag': {'time_constant': 4e-3},
}  # fmt: skip
#: Library effects that are no function of the basis: hidden states, past times, the measurement.
NO_FUNCTION = (
    'actuation_delay', 'base_resonance', 'controller_mismatch', 'drive_play',
    'encoder_quantisation', 'structural_resonance', 'tracker_clock_drift', 'tracker_latency',
)  # fmt: skip
NOMINAL_TWIN = TwinFile.from_dict(NOMINAL)


def simulated(
    effects: dict[str, dict[str, float]], seed: int, error: planted.Planted | None = None
) -> Session:
    """A session of the twin with some effects, and with a planted error of the table."""
    generator = np.random.default_rng(seed)
    period = NOMINAL_TWIN.control_period
    paths = [moves(generator, DURATION, period) for _ in 'xy']
    reference, velocity = (np.column_stack([p[i] for p in paths]) for i in (0, 1))
    time = np.arange(len(reference), dtype=float) * period
    warm = 20.0 + np.outer(1.0 - np.exp(-time / 15.0), generator.uniform(2.0, 6.0, 2))
    made = simulate(
        NOMINAL_TWIN.with_effects(effects), reference, velocity, temperatures=warm, seed=seed
    )
    points = made.tracker_points[:, :2].copy()
    if error is not None:
        x, y = (np.interp(made.tracker_stamps, time, made.encoder[:, i]) for i in (0, 1))
        points[:, 0] += planted.error(error, x, y, made.tracker_stamps)
    every = slice(None, None, 1000)
    return as_session(
        Recording(
            ('x', 'y'), time, reference, velocity, made.velocity_command, made.force,
            made.encoder, made.velocity, made.tracker_stamps, points, time[every], warm[every],
        ),
        seed,
    )  # fmt: skip


def session_of(effect: str, seed: int) -> Session:
    """A session with one effect: of the blind machine, or of the twin where that lacks it."""
    if effect in OF_TWIN:
        return simulated({f'{effect}.x': OF_TWIN[effect]}, seed)
    case = replace(draw_single(0, seed, effect), duration=DURATION)
    return as_session(run_machine(case), seed)


def effect_row(effect: str, seed: int) -> dict[str, Any]:
    """What the named effect closes, and what the law closes in its absence."""
    session = session_of(effect, seed)
    others = [name for name in LIBRARY if name != effect]
    named = diagnose([session], [], NOMINAL_TWIN, without=others)
    out = (effect, *SAME.get(effect, ()), *EFFECTS[effect])
    learned, standing_in = with_remainder(session, out)
    position = _closed(named.before, named.after, _with_laws(learned))
    rows = _rows(named, learned)
    forces = all(c.unit == 'N' for c in named.causes if c.effect.split('.')[0] == effect)
    return {
        'effect': effect, 'seed': seed, 'verdict': named.verdict, 'without': learned.verdict,
        'standing_in': standing_in,
        'laws': [{'channel': law.channel, 'kind': law.kind, 'expression': law.expression,
                  'shrink': law.shrink, 'instead': law.instead} for law in learned.laws],
        'position': position, 'rows': rows,
        # A force that the integral takes up moves no position.
        'counts': rows if forces or position is None else position,
    }  # fmt: skip


def with_remainder(session: Session, out: Sequence[str]) -> tuple[Diagnosis, list[str]]:
    """The diagnosis without some effects, and what else had to go until something remained.

    Where nothing remains there is nothing to have a law of.
    """
    found = diagnose([session], [], NOMINAL_TWIN, without=out)
    standing_in: list[str] = []
    while found.accepted and not found.structured:
        standing_in += sorted({split_effect(name)[0] for name in found.accepted})
        found = diagnose([session], [], NOMINAL_TWIN, without=[*out, *standing_in])
    return found, standing_in


def _closed(before: float, named: float, law: float) -> float | None:
    """Share of what the named effect closes that the law closes; None where it closes nothing."""
    return (before - law) / (before - named) if before > 1.02 * named else None


def _with_laws(found: Diagnosis) -> float:
    """Position gap [m] with the named effects and all laws."""
    less = sum(law.gap[0] ** 2 - law.gap[1] ** 2 for law in found.laws if law.runs)
    return float(np.sqrt(max(found.after**2 - less, 0.0)))


def _rows(named: Diagnosis, learned: Diagnosis) -> float | None:
    """The same share on the held-out rows of the residual that the named effect moves most."""
    best: tuple[float, float | None] = (0.0, None)
    for part, other in zip(named.parts, learned.parts, strict=True):
        rows = part.problem.held_out
        before, after = (float(np.mean(r[rows] ** 2)) for r in (part.problem.gap, part.residual))
        law = float(np.mean(other.residual[rows] ** 2))
        axes = 1 if part.name.startswith('servo') else len(named.records[0].axes)
        for one in learned.laws:
            if one.channel == f'force.{part.name[-1]}' or (
                part.name == 'tracker' and one.channel.startswith('error')
            ):
                law -= (one.before**2 - one.after**2) / axes
        gain = np.sqrt(before) - np.sqrt(after)
        if gain / part.problem.floor > best[0]:
            best = (gain / part.problem.floor, (np.sqrt(before) - np.sqrt(max(law, 0.0))) / gain)
    return best[1]


def none_row(seed: int) -> dict[str, Any]:
    """Laws that the search finds in the residuals of the nominal machine, no gate before it."""
    session = as_session(record({}, seed, ('x', 'y'), 20.0), seed)
    records = [load_record(session, NOMINAL_TWIN)]
    laws = []
    for axis in 'xy':
        rows = Servo(records, NOMINAL_TWIN, axis)
        laws.append(law_of(rows.problem(), force_signals(rows), axis, 0))
    kinematics = Kinematics(records, NOMINAL_TWIN, {})
    problem, where = kinematics.problem(), kinematics.row_axis()
    for i, axis in enumerate('xy'):
        own = axis_problem(problem, problem.target, where == i)
        laws.append(law_of(own, error_signals(kinematics, axis), axis, 0))
    return {'seed': seed, 'laws': [law.expression for law in laws if law is not None]}


def planted_row(law: int, seed: int) -> dict[str, Any]:
    """What is found of a planted law, the whole library at hand if something then remains."""
    truth = planted.draw(law, seed)
    if law < 5:
        values = {'amplitude': truth.amplitude, 'law': float(law), 'number': truth.number}
        session = simulated({'planted_force.x': values}, seed)
    else:
        session = simulated({}, seed, truth)
    found, standing_in = with_remainder(session, ())
    channel, words, kind = planted.LAWS[law]
    own = next((one for one in found.laws if one.channel == channel), None)
    letter = 'n' if kind == 'exponent' else 'b'
    numbers = (
        []
        if own is None
        else [
            (name, value, std)
            for name, (value, std, _) in own.parameters.items()
            if name[0] == letter
        ]
    )
    value = numbers[0][1] if numbers else float('nan')
    return {
        'law': law, 'seed': seed, 'words': words, 'number': truth.number, 'found': value,
        'standing_in': standing_in,
        'recovered': bool(numbers) and truth.recovered(value), 'verdict': found.verdict,
        'expression': own.expression if own else '', 'kind': own.kind if own else '',
        'shrink': own.shrink if own else 0.0, 'interval': own.interval if own else (0.0, 0.0),
    }  # fmt: skip


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point; rows that a file of results holds already are not made again."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--part', nargs='*', default=['effects', 'none', 'planted'])
    parser.add_argument('--seeds', type=int, default=1)
    parser.add_argument('--first', type=int, default=1, help='first seed')
    parser.add_argument('--sessions', type=int, default=100, help='without structure')
    parser.add_argument('--out', type=Path, default=Path('build/laws'))
    parser.add_argument('--page', type=Path, help='docs/results/law.md')
    options = parser.parse_args(arguments)
    options.out.mkdir(parents=True, exist_ok=True)
    seeds = range(options.first, options.first + options.seeds)
    jobs: dict[str, list[tuple[Callable[..., dict[str, Any]], tuple[Any, ...]]]] = {
        'effects': [(effect_row, (e, s)) for s in seeds for e in EFFECTS],
        'none': [(none_row, (s,)) for s in range(options.sessions)],
        'planted': [(planted_row, (k, s)) for s in seeds for k in planted.LAWS],
    }
    for part in options.part:
        for function, words in jobs[part]:
            path = options.out / f'{part}_{"_".join(map(str, words))}.json'
            row = kept(path, functools.partial(function, *words))
            print(json.dumps(row), flush=True)
    if options.page is not None:
        command = (
            f'python -m benchmarks.laws.run --first {options.first} --seeds {options.seeds} '
            f'--sessions {options.sessions} --page {options.page}'
        )
        wanted = {part: len(rows) for part, rows in jobs.items()}
        text = written.page(options.out, wanted, NO_FUNCTION, command)
        options.page.write_text(text, encoding='utf-8')
    return 0


if __name__ == '__main__':
    sys.exit(main())
