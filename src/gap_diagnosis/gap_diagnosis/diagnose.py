"""The diagnosis: sessions and a twin in, a verdict with its evidence out."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis import evidence as judge
from gap_diagnosis.data import Record, held_out_windows, inside, load_record
from gap_diagnosis.kinematics import Kinematics
from gap_diagnosis.localise import Condition, conditions, features
from gap_diagnosis.polish import polish
from gap_diagnosis.regression import Problem
from gap_diagnosis.replay import replay
from gap_diagnosis.selection import Rules, Selection, Selector, describe
from gap_diagnosis.servo import Servo
from stage_core.errors import StageError
from stage_core.quantities import EFFECT_LINKS, UNKNOWN, split_effect
from stage_core.session import Session
from stage_core.twin_file import TwinFile
from stage_twin.effects import EFFECTS

Array = NDArray[np.float64]
Progress = Callable[[str], None]

#: A gain in the force balance is told from noise that regressors share with the residual.
SERVO_RULES = Rules(of_noise=0.05, of_gap=6e-4)
KINEMATIC_RULES = Rules(of_gap=1e-5)


@dataclass
class Part:
    """One regression problem: the tracker channels together, or the force balance of an axis."""

    name: str  # 'tracker' or 'servo.x'
    problem: Problem
    selector: Selector
    selection: Selection
    residual: Array  # of all rows, in the target's unit, never whitened
    row_axis: NDArray[np.int64]
    structure: judge.Structure


@dataclass
class Channel:
    """One channel on the held-out rows: time [s] per record, gap before and after."""

    name: str
    unit: str
    time: list[Array]
    before: list[Array]
    after: list[Array]

    def rms(self, which: str) -> float:
        """Root mean square over the held-out rows of all records."""
        values = np.concatenate(getattr(self, which))
        return float(np.sqrt(np.mean(values**2)))


@dataclass
class Diagnosis:
    """Everything that the reports say."""

    sessions: list[str]
    twin_name: str
    twin: TwinFile
    records: list[Record]
    parts: list[Part]
    channels: dict[str, Channel]
    windows: list[tuple[float, float]]
    before: float
    after: float
    noise_floor: float
    accepted: list[str]
    parameters: dict[str, dict[str, tuple[float, float]]]
    causes: list[judge.Cause]
    verdict: list[str]
    conditions: list[Condition]
    axes_share: dict[str, float]
    link: str
    unexplained: float
    structured: bool
    warnings: list[str] = field(default_factory=list)

    @property
    def effects(self) -> dict[str, dict[str, float]]:
        """The accepted effects as a twin file holds them."""
        return {n: {k: v for k, (v, _) in self.parameters[n].items()} for n in self.accepted}

    @property
    def corrected_twin(self) -> TwinFile:
        """The nominal twin with the accepted effects in it."""
        return self.twin.with_effects(self.effects)


def silent(message: str) -> None:
    """Progress that nobody sees."""


def to_stderr(message: str) -> None:
    """Progress for a person at a terminal."""
    print(f'[gap_diagnosis] {message}', file=sys.stderr, flush=True)


def diagnose(
    sessions: Sequence[Session],
    holdout: Sequence[Session],
    twin: TwinFile,
    twin_name: str = 'twin',
    seed: int = 0,
    progress: Progress = silent,
    without: Sequence[str] = (),
) -> Diagnosis:
    """Diagnose the gap between sessions and a twin.

    Parameters
    ----------
    sessions, holdout : what the fit sees, and what only the judgement sees
    twin : the nominal twin, without effects
    seed : of the bootstrap and of the permutations
    without : effects taken out of the library (for the leave-one-effect-out check)

    Raises
    ------
    StageError
        If a session cannot be diagnosed; see :func:`gap_diagnosis.data.load_record`.
    """
    if twin.effects:
        raise StageError(
            f'{twin_name} already holds effects ({", ".join(twin.effects)}): diagnose with the '
            'nominal twin, which has none'
        )
    records = [load_record(s, twin) for s in sessions]
    records += [load_record(s, twin, held_out=True) for s in holdout]
    axes = records[0].axes
    if any(r.axes != axes for r in records):
        raise StageError('the sessions have different axes: diagnose them one by one')
    parts: list[Part] = []
    quantisation = {} if 'encoder_quantisation' in without else judge.encoder_steps(records, twin)
    seen = _with_steps(twin, quantisation)
    for axis in axes:
        if not any(r.moving[records[0].column(axis)] for r in records):
            continue
        progress(f'command -> encoder of axis {axis}: reading the equation of motion backwards')
        problem = Servo(records, seen, axis).problem()
        parts.append(_servo_part(axis, problem, records, twin, quantisation, seed, without))
        parts[-1].row_axis = np.full(len(parts[-1].problem.target), records[0].column(axis))
    if all(r.tracker is not None for r in records):
        progress('encoder -> table -> tracker: residual of the measurement')
        kinematics = Kinematics(records, seen)
        part = _part('tracker', kinematics.problem(), KINEMATIC_RULES, seed, without)
        part.row_axis = kinematics.row_axis()
        parts.append(part)
    parameters: dict[str, dict[str, tuple[float, float]]] = dict(quantisation)
    for part in parts:
        found = describe(part.selection, part.selector.regression)
        if twin.kind == 'servo' and part.name.startswith('servo') and found:
            axis = part.name[-1]
            progress(f'closed loop of axis {axis}: refining {", ".join(found)}')
            quantised = {n: v for n, v in quantisation.items() if n.endswith(f'.{axis}')}
            found = polish(records, twin, axis, {**quantised, **found})
        parameters.update(found)
    progress('closed-loop replay of the nominal and of the corrected twin')
    effects = {n: {k: v for k, (v, _) in p.items()} for n, p in parameters.items()}
    channels = _channels(records, twin, effects, parts)
    return _conclude(
        records, twin, twin_name, parts, parameters, channels, seed, progress, quantisation
    )


def _with_steps(
    twin: TwinFile, quantisation: dict[str, dict[str, tuple[float, float]]]
) -> TwinFile:
    """The twin with the encoder steps that the records really have: they are a noise floor."""
    axes = dict(twin.axes)
    for name, values in quantisation.items():
        axis = name[-1]
        axes[axis] = replace(axes[axis], encoder_resolution=values['resolution'][0])  # type: ignore[arg-type]
    return replace(twin, axes=axes)


def _part(name: str, problem: Problem, rules: Rules, seed: int, without: Sequence[str]) -> Part:
    if np.count_nonzero(problem.fit) < 200 or np.count_nonzero(problem.held_out) < 50:
        raise StageError(
            f'too little motion to judge {name}: only {np.count_nonzero(problem.fit)} samples '
            'in motion; record a longer session with `ros2 run contour_ctrl excite`'
        )
    for effect in without:
        base, axis = split_effect(effect)
        for term in [t for t in problem.terms if split_effect(t)[0] == base]:
            if axis is None or term == effect:
                del problem.terms[term]
    selector = Selector(problem, rules, seed)
    selection = selector.select()
    residual = selection.fit.residual
    found = judge.structure(problem, residual, _modelled(problem, selection, residual), name)
    rho = judge.slow_remainder(residual, problem.judged) if name == 'tracker' else 0.0
    if found.structured and rho > 0.0:
        # A slow drift hides what is fast and imitates what is slow: judge beside it. Effects
        # that are nearly the whole gap are no imitation.
        plain = {n: e for n, e in selection.evidence.items() if e.share > 0.96}
        selector = Selector(problem.whitened(rho), rules, seed, problem.target)
        selection = selector.select()
        selection = selector.with_given(selection, plain)
        residual = _residual(problem, selection)
        found = judge.structure(problem, residual, _modelled(problem, selection, residual), name)
    return Part(name, problem, selector, selection, residual, np.zeros(0, np.int64), found)


def _modelled(problem: Problem, selection: Selection, residual: Array) -> Array:
    """Residual with the effects of the sensor link alone taken out: what mechanics make."""
    out = residual.copy()
    for name, theta in selection.fit.thetas.items():
        if EFFECT_LINKS[split_effect(name)[0]] != 'sensor':
            out += problem.terms[name].columns(theta) @ selection.fit.coefficients[name]
    return out


def _residual(problem: Problem, selection: Selection) -> Array:
    """Residual of a selection that was fitted to whitened rows."""
    residual = problem.target.copy()
    for name, theta in selection.fit.thetas.items():
        residual -= problem.terms[name].columns(theta) @ selection.fit.coefficients[name]
    return residual


def _servo_part(
    axis: str,
    problem: Problem,
    records: list[Record],
    twin: TwinFile,
    quantisation: dict[str, dict[str, tuple[float, float]]],
    seed: int,
    without: Sequence[str],
) -> Part:
    """Force balance of an axis; an effect that the closed loop contradicts is taken out.

    A disturbance that nothing in the library explains is sometimes imitated in the force
    balance; the twin with such an effect then follows the record worse than without it.
    """
    barred = list(without)
    while True:
        part = _part(f'servo.{axis}', problem, SERVO_RULES, seed, barred)
        accepted = part.selection.accepted
        if not accepted or twin.kind != 'servo':
            return part
        found = describe(part.selection, part.selector.regression)
        found.update(quantisation)
        effects = {n: {k: v for k, (v, _) in p.items()} for n, p in found.items()}
        contradicted = _contradicted(axis, accepted, effects, records, twin)
        if not contradicted:
            return part
        barred += contradicted


def _contradicted(
    axis: str,
    accepted: list[str],
    effects: dict[str, dict[str, float]],
    records: list[Record],
    twin: TwinFile,
) -> list[str]:
    """Effects with which the closed loop follows the held-out record worse than without.

    Where the encoder's gap is large and all of them together close almost nothing of it, the
    force balance was imitated and all go. Below the encoder's step nothing is contradicted.
    """
    channel = f'encoder.{axis}'

    def gap(some: dict[str, dict[str, float]]) -> float:
        squares = []
        for record in [r for r in records if r.held_out_session] or records:
            mask = inside(record.time, held_out_windows(record))
            squares.append(replay(record, twin, some)[channel][mask] ** 2)
        return float(np.mean(np.concatenate(squares)))

    step = float(getattr(twin.axes[axis], 'encoder_resolution', 1e-6)) ** 2
    everything = gap(effects)
    if gap({}) > 4.0 * step and everything > 0.7 * gap({}):
        return list(accepted)
    losses = {n: everything - gap({k: v for k, v in effects.items() if k != n}) for n in accepted}
    worst = max(losses, key=lambda n: losses[n])
    return [worst] if losses[worst] > max(0.05 * everything, 0.05 * step) else []


def _in_session(
    record: Record,
    records: list[Record],
    effects: dict[str, dict[str, float]],
    parts: list[Part],
) -> dict[str, dict[str, float]]:
    """The effects with the nuisances (a phase) of one held-out session."""
    number = next(i for i, other in enumerate(records) if other is record)
    out = {n: dict(v) for n, v in effects.items()}
    for part in parts:
        for name, coefficients in part.selection.fit.sessions.get(number, {}).items():
            theta = part.selection.fit.thetas[name]
            values = part.problem.terms[name].parameters(theta, coefficients)
            for parameter in EFFECTS[split_effect(name)[0]].parameters:
                if parameter.nuisance and name in out and parameter.name in values:
                    out[name][parameter.name] = values[parameter.name]
    return out


def _channels(
    records: list[Record],
    twin: TwinFile,
    effects: dict[str, dict[str, float]],
    parts: list[Part],
) -> dict[str, Channel]:
    scored = [r for r in records if r.held_out_session] or records
    channels: dict[str, Channel] = {}
    for record in scored:
        before = replay(record, twin, {})
        after = replay(record, twin, _in_session(record, records, effects, parts))
        mask = inside(record.time, held_out_windows(record))
        for name in before:
            unit = 'N' if name.startswith('force') else 'm'
            channel = channels.setdefault(name, Channel(name, unit, [], [], []))
            channel.time.append(record.time[mask])
            channel.before.append(before[name][mask])
            channel.after.append(after[name][mask])
    for part in parts:
        if part.name != 'tracker':
            continue
        at = 0
        for record in records:
            assert record.tracker_time is not None
            count = len(record.tracker_time)
            for axis in record.axes:
                rows = slice(at, at + count)
                at += count
                if not any(record is other for other in scored):
                    continue
                mask = part.problem.held_out[rows]
                name = f'tracker.{axis}'
                channel = channels.setdefault(name, Channel(name, 'm', [], [], []))
                channel.time.append(record.tracker_time[mask])
                channel.before.append(part.problem.target[rows][mask])
                channel.after.append(part.residual[rows][mask])
    return channels


def position_rms(channels: dict[str, Channel], which: str) -> float:
    """Root mean over the position channels of each channel's squared RMS [m]."""
    squares = [c.rms(which) ** 2 for c in channels.values() if c.unit == 'm']
    return float(np.sqrt(np.mean(squares)))


def _conclude(
    records: list[Record],
    twin: TwinFile,
    twin_name: str,
    parts: list[Part],
    parameters: dict[str, dict[str, tuple[float, float]]],
    channels: dict[str, Channel],
    seed: int,
    progress: Progress,
    quantisation: dict[str, dict[str, tuple[float, float]]],
) -> Diagnosis:
    scored = [r for r in records if r.held_out_session] or records
    effects = {n: {k: v for k, (v, _) in p.items()} for n, p in parameters.items()}
    before, after = position_rms(channels, 'before'), position_rms(channels, 'after')
    progress('leaving out one cause at a time')
    causes = [
        _cause(name, effects, scored, twin, parts, channels, parameters, seed) for name in effects
    ]
    # The largest contribution to the gap first.
    causes.sort(key=lambda c: -(c.gap_before - c.gap_after))
    accepted = [c.effect for c in causes]
    structured = any(p.structure.structured for p in parts)
    verdict = accepted + ([UNKNOWN] if structured else [])
    progress('where the gap lies')
    found = _conditions(scored, records, twin, parts, seed)
    shares, worst = _shares(records[0].axes, channels, twin)
    link = EFFECT_LINKS[split_effect(accepted[0])[0]] if accepted else worst
    others = judge.rejected_causes(parts, accepted, structured, before, after)
    floor = judge.noise_floor(twin, channels, effects)
    return Diagnosis(
        sessions=[r.name for r in records],
        twin_name=twin_name,
        twin=twin,
        records=records,
        parts=parts,
        channels=channels,
        windows=[w for r in scored for w in held_out_windows(r)],
        before=before,
        after=after,
        noise_floor=floor,
        accepted=accepted,
        parameters=parameters,
        causes=judge.probabilities(causes, others, parts, structured),
        verdict=verdict,
        conditions=found,
        axes_share=shares,
        link=link,
        unexplained=float(np.clip(max(after**2 - floor**2, 0.0) / max(before**2, 1e-30), 0, 1)),
        structured=structured,
        warnings=[w for r in records for w in r.warnings],
    )


def _cause(
    name: str,
    effects: dict[str, dict[str, float]],
    scored: list[Record],
    twin: TwinFile,
    parts: list[Part],
    channels: dict[str, Channel],
    parameters: dict[str, dict[str, tuple[float, float]]],
    seed: int,
) -> judge.Cause:
    """Gap without this one cause, gap with all of them, and the interval of the difference."""
    rest = {n: v for n, v in effects.items() if n != name}
    part = next((p for p in parts if name in p.selection.accepted), None)
    squares_without: list[Array] = []
    squares_with: list[Array] = []
    for channel in channels.values():
        if channel.unit != 'm':
            continue
        squares_with.append(np.concatenate([a**2 for a in channel.after]))
    lesser = _lesser(name, rest, scored, twin, part, channels)
    for channel in channels.values():
        if channel.unit == 'm':
            squares_without.append(np.concatenate([a**2 for a in lesser[channel.name]]))
    gap_before = float(np.sqrt(np.mean([s.mean() for s in squares_without])))
    gap_after = float(np.sqrt(np.mean([s.mean() for s in squares_with])))
    pairs = [
        np.array([np.array_split(s, 12)[j].mean() for s in side]).mean()
        for side in (squares_without, squares_with)
        for j in range(12)
    ]
    without_blocks, with_blocks = np.array(pairs[:12]), np.array(pairs[12:])
    generator = np.random.default_rng(seed)
    picks = generator.integers(0, 12, (500, 12))
    shrinks = 1.0 - np.sqrt(
        with_blocks[picks].mean(axis=1) / np.maximum(without_blocks[picks].mean(axis=1), 1e-30)
    )
    low, high = np.percentile(shrinks, [2.5, 97.5])
    found = part.selection.evidence[name] if part is not None else None
    return judge.Cause(
        effect=name,
        probability=0.0,
        parameters=parameters[name],
        gap_before=gap_before,
        gap_after=gap_after,
        interval=(float(low), float(high)),
        status='accepted',
        alternatives=list(found.alternatives) if found is not None else [],
        strength=judge.strength(part, name),
    )


def _lesser(
    name: str,
    rest: dict[str, dict[str, float]],
    scored: list[Record],
    twin: TwinFile,
    part: Part | None,
    channels: dict[str, Channel],
) -> dict[str, list[Array]]:
    """Gap of every channel with one cause taken out of the corrected twin, not refitted."""
    out = {c.name: list(c.after) for c in channels.values()}
    if part is not None and part.name == 'tracker':
        contribution = part.problem.terms[name].columns(part.selection.fit.thetas[name])
        contribution = contribution @ part.selection.fit.coefficients[name]
        at = 0
        for channel in ('tracker.x', 'tracker.y'):
            if channel not in channels:
                continue
            axis_rows = part.problem.held_out & (
                part.row_axis == list(scored[0].axes).index(channel[-1])
            )
            values = contribution[axis_rows]
            at = 0
            for j, after in enumerate(out[channel]):
                out[channel][j] = after + values[at : at + len(after)]
                at += len(after)
        return out
    for j, record in enumerate(scored):
        gaps = replay(record, twin, rest)
        mask = inside(record.time, held_out_windows(record))
        for channel, gap in gaps.items():
            out[channel][j] = gap[mask]
    return out


def _conditions(
    scored: list[Record], records: list[Record], twin: TwinFile, parts: list[Part], seed: int
) -> list[Condition]:
    found: list[Condition] = []
    total = {}
    for part in parts:
        for i, axis in enumerate(records[0].axes):
            # One session's bags at a time: the conditions are functions of its own time.
            rows = (part.row_axis == i) & (part.problem.record == 0)
            if not rows.any():
                continue
            excess = part.problem.mean_square(rows) - part.problem.floor**2
            total[part.name, axis] = excess / part.problem.floor**2
            if excess < 0.5 * part.problem.floor**2:
                continue
            record = records[0]
            time = part.problem.time[rows]
            step = max(1, len(time) // 6000)
            lead = float(getattr(twin.axes[axis], 'lead', 0.01))
            bases = features(record, axis, time[::step], lead, twin.temperature_reference)
            link = 'servo' if part.name.startswith('servo') else 'kinematic'
            found += conditions(
                part.problem.target[rows][::step],
                bases,
                part.problem.block[rows][::step],
                axis,
                link,
                seed,
            )
    return sorted(found, key=lambda c: (c.p_value >= 0.05, -c.share))


def _shares(
    axes: tuple[str, ...], channels: dict[str, Channel], twin: TwinFile
) -> tuple[dict[str, float], str]:
    """Share of each axis in the gap above the floor, and the link with the largest gap."""
    excess = {}
    for channel in channels.values():
        if channel.unit == 'm':
            floor = judge.channel_floor(twin, channel.name)
            excess[channel.name] = max(channel.rms('before') ** 2 - floor**2, 0.0)
    total = sum(excess.values()) or 1.0
    shares = {a: sum(v for n, v in excess.items() if n.endswith(f'.{a}')) / total for a in axes}
    worst = max(excess, key=lambda n: excess[n])
    return shares, 'servo' if worst.startswith('encoder') else 'kinematic'
