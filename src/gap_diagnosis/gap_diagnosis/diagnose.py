"""The diagnosis: sessions and a twin in, a verdict with its evidence out."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from threadpoolctl import threadpool_limits

from gap_diagnosis.closed_loop.axis_loop import AxisLoop
from gap_diagnosis.closed_loop.channels import (
    Channel,
    as_stated,
    axis_shares,
    gap_channels,
    noise_notes,
    position_rms,
)
from gap_diagnosis.closed_loop.creep import with_presliding
from gap_diagnosis.closed_loop.dither import sticks
from gap_diagnosis.closed_loop.encoder_waves import with_waves_of_tracker
from gap_diagnosis.closed_loop.rests import rest_notes, with_rests
from gap_diagnosis.closed_loop.steps import unrepeated_steps
from gap_diagnosis.closed_loop.unexplained import Sliding, far, grown_notes, sliding_axes
from gap_diagnosis.evidence import judgement as judge
from gap_diagnosis.evidence.causes import Run, cause_of, shown_by_encoder, swings, unrepeated_notes
from gap_diagnosis.evidence.describe import (
    describe,
    surer,
)
from gap_diagnosis.evidence.left_out import left_out
from gap_diagnosis.evidence.localise import conditions_of
from gap_diagnosis.evidence.probability import Scene, with_probabilities
from gap_diagnosis.input.checks import turns
from gap_diagnosis.input.data import Record
from gap_diagnosis.input.reading_wave import MISREADS
from gap_diagnosis.input.rest_places import rest_places
from gap_diagnosis.input.windows import held_out_windows, judging
from gap_diagnosis.law.judged import Law
from gap_diagnosis.law.learn import learn
from gap_diagnosis.memory import Memory
from gap_diagnosis.parameters import Parameters, plain_values
from gap_diagnosis.passes import Prepared, Progress, prepare, servo_part
from gap_diagnosis.residuals.recording import in_another_unit, jitter_findings
from gap_diagnosis.residuals.tracker_jitter import tracker_jitter, tracker_speeds
from gap_diagnosis.residuals.without_forces import widened
from gap_diagnosis.result import Diagnosis
from gap_diagnosis.selection.parts import Part
from gap_diagnosis.selection.shape import with_shape_of
from gap_diagnosis.tracker_pass import tracker_part
from stage_core.quantities import UNKNOWN, split_effect
from stage_core.session import Session
from stage_core.twin_file import TwinFile
from stage_twin.effects import link_of
from stage_twin.packing import pack


def silent(message: str) -> None:
    """Progress that nobody sees."""


def to_stderr(message: str) -> None:
    """Progress for a person at a terminal."""
    print(f'[gap_diagnosis] {message}', file=sys.stderr, flush=True)


# The order of a BLAS library's sums follows its threads: a fit with many local optima must not
# depend on the number of cores.
@threadpool_limits.wrap(limits=1, user_api='blas')
def diagnose(
    sessions: Sequence[Session],
    holdout: Sequence[Session],
    twin: TwinFile,
    twin_name: str = 'twin',
    seed: int = 0,
    progress: Progress = silent,
    without: Sequence[str] = (),
    simulated: Sequence[Session] = (),
) -> Diagnosis:
    """Diagnose the gap between sessions and a twin, or a simulator's runs of their commands.

    Parameters
    ----------
    sessions, holdout : what the fit sees, and what only the judgement sees
    twin : the nominal twin; effects that it has are part of its prediction
    seed : of the bootstrap and of the permutations
    without : effects taken out of the library (for the leave-one-effect-out check)
    simulated : of each session and each held-out one, what stands for the twin's prediction

    Raises
    ------
    StageError
        If a session cannot be diagnosed; see :func:`gap_diagnosis.input.data.load_record`.
    """
    pack(twin)  # refuses effects that there are not
    memory = Memory()
    prepared = prepare(sessions, holdout, twin, without, simulated)
    barred, least, asked, again = list(prepared.without), dict[str, float](), set[str](), True
    while True:
        result = _diagnose(prepared, twin_name, seed, progress, barred, memory)
        refuted = {c.effect for c in result.causes if c.refuted}
        shown = {n: values for n, values in result.parameters.items() if n not in refuted}
        unit = in_another_unit(shown, barred)
        if unit is not None and unit not in asked:
            progress(f'{unit} is one factor of both gains: another unit of the effort?')
            asked.add(unit)
            other = prepare(sessions, holdout, twin, [*prepared.without, unit], simulated)
            if f'effort_convention.{split_effect(unit)[1]}' in other.direct:
                # What was refuted beside the wrong unit may be there beside the right one.
                prepared, memory, barred = other, Memory(), list(other.without)
                least.clear()
                again = True
                continue
        rested, again = _rested(prepared, result) if again else prepared, False
        if rested is not prepared:
            prepared, memory = rested, Memory()
            continue
        out, why = left_out(result, prepared, least, seed)
        if not out:
            if result.structured or not result.accepted:
                progress('a law of what remains')
                result.laws = _laws(result, seed)
            result.started = sessions[0].recorded_ns
            judge.name_beside_unknown(result.causes, result.parts, barred[len(without) :])
            return result
        progress(why)
        barred += out
        # How the twin rests best was found beside a friction that is no more.
        again = sticks(out)


def _laws(result: Diagnosis, seed: int) -> list[Law]:
    """Laws of what the effects leave."""
    effects, channels = result.run_effects, result.channels
    return learn(result.records, result.twin, result.parts, effects, channels, seed)


def _rested(prepared: Prepared, result: Diagnosis) -> Prepared:
    """The same, but for how the twin with the effects that were found rests best."""
    refuted = {c.effect for c in result.causes if c.refuted}
    named = [n for n in result.accepted if n not in refuted]
    held = {split_effect(n)[1] for n in named if sticks([n])}
    told = [own for part in result.parts for own in part.presliding.items()]
    stated = {n: found for n, found in told if split_effect(n)[1] not in held}
    effects = {n: v for n, v in result.run_effects.items() if n in named or not sticks([n])}
    twin = with_presliding(prepared.records, prepared.twin, effects, stated)
    if twin is prepared.twin:
        effects = result.run_effects
    else:
        prepared = prepared.with_frictions(twin)
    records = with_rests(prepared.records, prepared.twin, effects)
    same = [r.noise for r in records] == [r.noise for r in prepared.records]
    return prepared if same else replace(prepared, records=records)


def _diagnose(
    before: Prepared,
    twin_name: str,
    seed: int,
    progress: Progress,
    without: Sequence[str],
    memory: Memory,
) -> Diagnosis:
    """One pass from the records to a verdict, some effects taken out of the library."""
    twin = before.twin
    direct = _allowed(before.direct, without)
    parts = [
        servo_part(before, axis, direct, seed, without, memory, progress)
        for axis in before.moving_axes
    ]
    known = direct
    shown = [_refined(p, before, known, progress) for p in parts]
    records, tracker = tracker_part(before, shown, seed, without, memory, progress)
    for measured in tracker:
        read = with_waves_of_tracker(before.records, twin, measured, direct, before.loops)
        found = measured.selection.accepted
        known = {**direct, **{n: v for n, v in read[0].waves.items() if n in found}}
        moved = replace(before, records=read)
        parts = [
            servo_part(moved, p.name[-1], known, seed, without, memory, progress)
            if f'{MISREADS}.{p.name[-1]}' in found
            else with_shape_of(p, measured)
            for p in parts
        ]
    parts += tracker
    parameters: Parameters = dict(known)
    for part in parts:
        for name, values in _refined(part, before, known, progress).items():
            parameters[name] = surer(parameters.get(name, {}), values)
    jitter = jitter_findings(records, twin, parameters, tracker_jitter(parts))
    parameters.update(_allowed(jitter, without))
    return _conclude(records, before, twin_name, parts, parameters, seed, progress)


def _refined(part: Part, before: Prepared, known: Parameters, progress: Progress) -> Parameters:
    """The parameters of a part's effects; those of a servo's loop are refined in it."""
    plain = describe(part.selection, part.selector.regression)
    if before.twin.kind != 'servo' or not part.name.startswith('servo') or not plain:
        return plain
    axis = part.name[-1]
    progress(f'closed loop of axis {axis}: refining {", ".join(plain)}')
    found = AxisLoop(before.records, before.twin, axis, known, before.loops).refined(plain)
    return widened(found, before.laws[axis]) if axis in before.laws else found


def _allowed(found: Parameters, without: Sequence[str]) -> Parameters:
    """Findings whose effect is not taken out of the library."""
    return {n: v for n, v in found.items() if not set(without) & {n, split_effect(n)[0]}}


def _structured(parts: list[Part]) -> list[Part]:
    """Parts whose residual is more than noise."""
    return [part for part in parts if part.structure.structured]


def _unrepeated(
    records: list[Record], twin: TwinFile, parts: list[Part], effects: dict[str, dict[str, float]]
) -> tuple[str, ...]:
    """Effects that the loop is run without: at a phase of their own they only add to the gap."""
    calm = {n: v for n, v in effects.items() if n not in swings(parts)}
    return (*swings(parts), *unrepeated_steps(records, twin, calm))


def _windows(scored: list[Record]) -> list[tuple[float, float]]:
    """Starts and ends of what was held out [s from each session's start]."""
    return [(r.session_time(a), r.session_time(b)) for r in scored for a, b in held_out_windows(r)]


def _notes(
    records: list[Record],
    prepared: Prepared,
    channels: dict[str, Channel],
    told: dict[str, dict[str, float]],
    unrepeated: Sequence[str],
    slides: dict[str, Sliding],
) -> list[str]:
    """What a reader has to know beside the verdict."""
    rested = rest_places(records)
    return [
        *(rested.few() if rested is not None else []),
        *dict.fromkeys(warning for record in records for warning in record.warnings),
        *prepared.notes,
        *rest_notes(records[0]),
        *unrepeated_notes(unrepeated),
        *noise_notes(records, prepared.twin, told, channels),
        *grown_notes(channels, slides),
    ]


def _conclude(
    records: list[Record],
    prepared: Prepared,
    twin_name: str,
    parts: list[Part],
    parameters: Parameters,
    seed: int,
    progress: Progress,
) -> Diagnosis:
    twin, seen, scored = prepared.twin, prepared.seen, judging(records)
    progress('closed-loop replay of the nominal and of the corrected twin')
    effects = plain_values(parameters)
    unrepeated = _unrepeated(records, twin, parts, effects)
    told = {n: v for n, v in effects.items() if n not in unrepeated}
    channels = gap_channels(records, twin, told, parts)
    before, after = position_rms(channels, 'before'), position_rms(channels, 'after')
    progress('leaving out one cause at a time')
    floors = {n: judge.channel_floor(seen, n) for n in channels}
    slides = sliding_axes(scored, prepared, told)
    run = Run(scored, twin, parts, channels, parameters, floors, seed, unrepeated, slides)
    # The largest contribution to the gap first.
    causes = sorted((cause_of(n, run) for n in effects), key=lambda c: c.gap_after - c.gap_before)
    accepted = [c.effect for c in causes]
    speeds = tracker_speeds(records)
    floor = judge.noise_floor(seen, channels, effects, speeds)
    structured = (
        any(shown_by_encoder(p, channels, floors, twin, accepted) for p in _structured(parts))
        or far(records, prepared, swings(parts), channels, effects, told, speeds)
        or not prepared.laws_known
    )
    progress('where the gap lies')
    others = judge.rejected_causes(parts, accepted, structured, before, after)
    share = max((p.structure.share for p in _structured(parts)), default=0.0)
    if not prepared.rests_as_stated:
        channels = as_stated(channels, records, prepared.stated)
    before = position_rms(channels, 'before')  # of the twin as its file states it
    scene = Scene(before / floor, after / floor, share, structured, turns(scored))
    shares, worst = axis_shares(records[0].axes, channels, seen)
    return Diagnosis(
        twin_name=twin_name,
        twin=twin,
        records=records,
        parts=parts,
        channels=channels,
        windows=_windows(scored),
        before=before,
        after=after,
        noise_floor=floor,
        parameters=parameters,
        causes=with_probabilities(causes, others, scene),
        verdict=accepted + ([UNKNOWN] if structured else []),
        conditions=conditions_of(scored, records, twin, parts, seed),
        axes_share=shares,
        link=link_of(accepted[0]) if accepted else worst,
        unexplained=float(np.clip(max(after**2 - floor**2, 0.0) / max(before**2, 1e-30), 0, 1)),
        warnings=_notes(records, prepared, channels, told, unrepeated, slides),
        drives=prepared.laws,
        unrepeated=unrepeated,
        rests_as_stated=prepared.rests_as_stated,
    )
