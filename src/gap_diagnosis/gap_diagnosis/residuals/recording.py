"""What a record tells of how it was made: sign and unit of the effort, jitter of its stamps.

The controller reads and writes recorded quantities, so that its law says which force belongs to
each tick; the motion says which force the mass needed. An effort that is the law's times a factor,
while the mass needed the law's force itself, is in another unit or of another sign. It is then
divided by the factor, and the diagnosis goes on with newtons.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from gap_diagnosis.input.checks import check_controller
from gap_diagnosis.input.data import Record
from gap_diagnosis.input.noise import LEAST_JITTER, jitter_finding
from gap_diagnosis.parameters import Estimates, Parameters, plain_values
from gap_diagnosis.residuals.control_law import (
    NO_WORSE,
    Law,
    fit_law,
    force_increments,
    levels,
    quiet,
    velocity_law,
)
from gap_diagnosis.residuals.controller import MISMATCH
from gap_diagnosis.residuals.effort_signs import signs_of
from gap_diagnosis.residuals.low_pass import smooth
from gap_diagnosis.residuals.operators import central_difference, centred_hold, second_difference
from stage_core.arrays import Array
from stage_core.quantities import split_effect
from stage_core.twin_file import ServoAxis, TwinFile

CONVENTION = 'effort_convention'
#: Share of the recorded increments' mean square that the law times a factor must explain.
FOLLOWED = 0.9
#: Distance (of logarithms) that effort over needed force may have from the factor, over that from
#: 1, where it is for a controller of other gains: 0.00 to 0.03 of units alone, 0.41 beside a play.
NEARER = 0.5
#: Factor beyond which an effort is in another unit whatever moves, such as a spring that hides the
#: mass on a circle: the gains of 17 other controllers were 0.5 to 1.5 times the twin's.
NO_GAIN = 3.0
#: Share by which a unit differs from the newton at least: a position gain wrong by 0.018 makes
#: 0.002 of it.
LEAST_UNIT = 0.02
#: RMS that a unit may leave of the recorded increments over what a controller with other gains
#: leaves, where the effort has no noise of its own: 0.9 to 1.1 of records in another unit, 3000
#: and more of controllers with other gains.
ANOTHER_LAW = 2.0
#: Share of the recorded increments that rounding may leave: 1e-14 of records in another unit, 6e-3
#: and more of controllers with other gains.
ROUNDED = 1e-9
#: Gains of the velocity loop, which the factor of a unit changes alike.
LOOP = {'velocity_gain_error', 'integral_gain_error'}
CORNER = 30.0  # Hz, of the low-pass on forces
#: Deviations of a factor from zero: a law that the increments do not follow at all has about one.
SHOWN = 5.0
#: Deviations of an effort's noise by which one without signs may be below zero.
BELOW_ZERO = 5.0
#: Share of ticks of the other sign, from which on a record without signs has lost them.
BOTH_SIGNS = 0.01


def in_newtons(
    records: list[Record], twin: TwinFile, without: Sequence[str]
) -> tuple[list[Record], Parameters]:
    """The records with their forces in newtons, and `effort_convention` where the twin lacks it.

    Raises
    ------
    StageError
        If a record lacks velocity commands, or holds forces beyond the twin's limit.
    """
    if twin.kind != 'servo' or not all(r.effort_recorded for r in records):
        return records, {}
    stated = {n: v for n, v in twin.effects.items() if split_effect(n)[0] == CONVENTION}
    records = [_converted(r, twin, stated) for r in records]
    found = _found(records, twin, without)
    plain = plain_values(found)
    records = [_converted(r, twin, plain) for r in records]
    for record in records:
        check_controller(record, twin)
    for name, values in found.items():
        before = stated.get(name, {}).get('factor', 1.0)
        values['factor'] = (values['factor'][0] * before, values['factor'][1] * abs(before))
    return records, found


def _found(records: list[Record], twin: TwinFile, without: Sequence[str]) -> Parameters:
    """`effort_convention` of the axes.

    Where the mass of an axis at rest does not tell, the factor of the other axis does. Where its
    controller is known to have the twin's gains, a factor is a unit.
    """
    found: Parameters = {}
    doubted: Parameters = {}
    for i, axis in enumerate(records[0].axes):
        name = f'{CONVENTION}.{axis}'
        own_gains = f'{MISMATCH.name}.{axis}' in without
        values, sure = _convention(records, i, twin, own_gains)
        sure = sure or own_gains
        if values and not {name, CONVENTION} & set(without):
            (found if sure else doubted)[name] = values
    factors = [v['factor'][0] for v in found.values()]
    for name, values in doubted.items():
        if any(abs(values['factor'][0] / f - 1.0) < LEAST_UNIT for f in factors):
            found[name] = values
    return found


def in_another_unit(found: Parameters, without: Sequence[str]) -> str | None:
    """The gains of an axis that stand for the unit of its effort: both wrong by one factor.

    A drive gives that much less per force, so that the loop is the twin's, or without a drive the
    factor is beyond those of controllers (`NO_GAIN`).
    """
    for name, gains in found.items():
        effect, axis = split_effect(name)
        drive = found.get(f'drive_gain.{axis}')
        barred = {CONVENTION, f'{CONVENTION}.{axis}'} & set(without)
        if effect != MISMATCH.name or set(gains) != LOOP or barred:
            continue
        factor, other = (1.0 + gains[gain][0] for gain in sorted(LOOP))
        if drive is None:
            unit = not 1.0 / NO_GAIN < factor < NO_GAIN
        else:
            unit = abs(factor * (1.0 + drive['error'][0]) - 1.0) < LEAST_UNIT
        if abs(other / factor - 1.0) < LEAST_UNIT and unit:
            return name
    return None


def jitter_findings(
    records: list[Record],
    twin: TwinFile,
    found: Mapping[str, object],
    points: tuple[float, float] | None,
) -> Parameters:
    """`sample_jitter` where the moments of reading scatter otherwise than the twin says.

    An encoder that errs within its period scatters like late samples: it is not asked. `points`
    is the jitter of the tracker's points, where they show one.
    """
    least = LEAST_JITTER * twin.control_period
    noises = [r.noise for r in records if r.noise is not None]
    doubted = [f'encoder_interpolation.{axis}' in found for axis in records[0].axes]
    jitter = jitter_finding(noises, twin.control_period, doubted)
    stated = twin.effects.get('sample_jitter', {})
    if jitter is None or abs(jitter[0] - stated.get('std', 0.0)) < least:
        jitter = None
    if points is not None and abs(points[0] - stated.get('tracker_std', 0.0)) < least:
        points = None
    if jitter is None and points is None:
        return {}
    none = (0.0, 0.0)
    return {'sample_jitter': {'std': jitter or none, 'tracker_std': points or none}}


def _converted(
    record: Record, twin: TwinFile, conventions: Mapping[str, Mapping[str, float]]
) -> Record:
    """The record with the force [N] behind efforts of these conventions."""
    force = record.force.copy()
    noises = list(record.noise.axes) if record.noise is not None else []
    for i, axis in enumerate(record.axes):
        values = conventions.get(f'{CONVENTION}.{axis}')
        if values is None:
            continue
        force[:, i] /= values['factor']
        if values['magnitude'] > 0.5:
            force[:, i] *= signs_of(record, i, twin.servo(axis), force[:, i])
        if noises:
            noises[i] = replace(noises[i], effort=noises[i].effort / abs(values['factor']))
    noise = None if record.noise is None else replace(record.noise, axes=tuple(noises))
    return replace(record, force=force, noise=noise)


def _convention(
    records: list[Record], i: int, twin: TwinFile, own_gains: bool
) -> tuple[Estimates, bool]:
    """`effort_convention` of an axis, empty where its effort is the force; whether it is sure.

    Where the controller is known to have the twin's gains (`own_gains`), the noise of the effort
    itself may be left of its increments.
    """
    judged = [r for r in records if np.isfinite(r.velocity_command[:, i]).all()]
    if not judged:
        return {}, False
    axis = twin.servo(records[0].axes[i])
    efforts = [r.force[:, i] for r in judged]
    least = [0.0 if r.noise is None else -BELOW_ZERO * r.noise.axes[i].effort for r in judged]
    written, law = _all_increments(judged, i, axis, efforts)
    if not law.any():  # an axis at rest whose encoder shows no noise
        return {}, False
    factor, left = _factor(written, law)
    # What follows the law to the last digits has its signs, even where noise is all it holds.
    exact = left < ROUNDED**2 * float(np.mean(written**2))
    unsigned = not exact and all(e.min() >= low for e, low in zip(efforts, least, strict=True))
    if unsigned:
        signs = [signs_of(r, i, axis, e) for r, e in zip(judged, efforts, strict=True)]
        unsigned = float(np.mean(np.concatenate(signs) < 0.0)) > BOTH_SIGNS
    if unsigned:
        efforts = [e * s for e, s in zip(efforts, signs, strict=True)]
        written, law = _all_increments(judged, i, axis, efforts)
        factor, left = _factor(written, law)
    noise = _noise_of_increments(judged, i) if own_gains else 0.0
    own = None
    if not _followed(written, left, noise) or abs(factor - 1.0) >= LEAST_UNIT:
        own = fit_law(_with_efforts(judged, i, efforts), i, _unclipped(axis, efforts))
        if own.noisy:
            # That noise is much of the increments, and little of the effort.
            written, law = _all_increments(judged, i, axis, efforts, whole=True)
            (factor, left), noise = _factor(written, law), 0.0
    deviation = math.sqrt(left / float(law @ law))
    if not _followed(written, left, noise) or abs(factor) < SHOWN * deviation:
        return {}, False
    if own is None or abs(factor - 1.0) < max(LEAST_UNIT, 3.0 * deviation):
        return (
            {'factor': (1.0, deviation), 'magnitude': (1.0, deviation)} if unsigned else {}
        ), True
    values = {'factor': (factor, deviation), 'magnitude': (float(unsigned), 0.0)}
    # A loop whose gain has the other sign would run away.
    if factor < 0.0:
        return values, True
    if not math.sqrt(left) <= _most_left(judged, i, own, efforts, written):
        return {}, False
    moved = math.log(max(_moved_by(judged, i, axis, efforts), 1e-300))
    told = abs(moved - math.log(factor)) < NEARER * abs(moved)
    told = told or abs(math.log(factor)) > math.log(NO_GAIN)
    return values, told and any(r.moving[i] for r in judged)


def _most_left(
    records: list[Record], i: int, own: Law, efforts: list[Array], written: Array
) -> float:
    """RMS [N] that a unit may leave of what was written (n,) beside the best law of any gains.

    It is not a number where each tick that fits is clipped.
    """
    if own.noisy:
        _, best = _all_increments(records, i, own.gains, efforts, whole=True)
        return NO_WORSE * float(np.sqrt(np.mean((written - best) ** 2)))
    return ROUNDED * float(np.sqrt(np.mean(written**2))) + ANOTHER_LAW * own.left


def _followed(written: Array, left: float, noise: float) -> bool:
    """Whether a factor leaves little of what was written (n,) beyond a noise (mean squares)."""
    shown = float(np.mean(written**2)) - noise
    return left - noise <= (1.0 - FOLLOWED) * max(shown, 0.0)


def _all_increments(
    records: list[Record], i: int, axis: ServoAxis, efforts: list[Array], whole: bool = False
) -> tuple[Array, Array]:
    pairs = [_increments(r, i, axis, e, whole) for r, e in zip(records, efforts, strict=True)]
    written, law = (np.concatenate(side) for side in zip(*pairs, strict=True))
    return written, law


def _noise_of_increments(records: list[Record], i: int) -> float:
    """Mean square [N^2] that the noise of efforts makes of their increments."""
    squares = []
    for record in records:
        pulse = np.zeros(len(record.time))
        pulse[len(pulse) // 2] = 0.0 if record.noise is None else record.noise.axes[i].effort
        squares.append(float(np.sum(quiet(record, i, np.diff(pulse)) ** 2)))
    return float(np.average(squares, weights=[len(r.time) for r in records]))


def _factor(written: Array, law: Array) -> tuple[float, float]:
    """Factor of the law's increments that is nearest to the recorded ones, and what it leaves."""
    factor = float(written @ law / (law @ law))
    return factor, float(np.mean((written - factor * law) ** 2))


def _with_efforts(records: list[Record], i: int, efforts: list[Array]) -> list[Record]:
    """The records with other efforts of one axis."""
    column = np.arange(records[0].force.shape[1]) == i
    return [
        replace(r, force=np.where(column, e[:, None], r.force))
        for r, e in zip(records, efforts, strict=True)
    ]


def _unclipped(axis: ServoAxis, efforts: list[Array]) -> ServoAxis:
    """The axis with the largest of its efforts as its limit, whatever their unit."""
    return replace(axis, force_limit=max(float(np.abs(effort).max()) for effort in efforts))


def _increments(
    record: Record, i: int, axis: ServoAxis, effort: Array, whole: bool
) -> tuple[Array, Array]:
    """Increments of the effort and those of the law's force [N], where neither is clipped.

    As a `whole` they are summed up again.
    """
    law = force_increments(record, i, axis, velocity_law(record, i, axis))
    size = np.abs(effort)
    use = (size < 0.999 * size.max()) & record.whole(record.time)
    use[:5] = False
    both = use[1:] & use[:-1]
    if whole:
        return levels(record, i, np.diff(effort), both), levels(record, i, law, both)
    # What is clipped follows no law: a filter would spread it over the ticks beside it.
    written, law = (np.where(both, rows, 0.0) for rows in (np.diff(effort), law))
    return quiet(record, i, written)[both], quiet(record, i, law)[both]


def _moved_by(records: list[Record], i: int, axis: ServoAxis, efforts: list[Array]) -> float:
    """Effort over the force [N] that the nominal motion needs, beside friction and an offset."""
    rows, target = [], []
    for record, effort in zip(records, efforts, strict=True):
        q, period = record.encoder[:, i], record.period
        speed = central_difference(q, period)
        needed = axis.mass * second_difference(q, period) + axis.viscous * speed
        slides = np.sign(smooth(speed, period, CORNER))
        whole = record.whole(record.time)
        signals = np.column_stack([needed, slides, np.ones_like(q)])
        rows.append(smooth(signals, period, CORNER)[whole])
        target.append(smooth(centred_hold(effort, axis.delay / period), period, CORNER)[whole])
    return float(np.linalg.lstsq(np.concatenate(rows), np.concatenate(target), rcond=None)[0][0])
