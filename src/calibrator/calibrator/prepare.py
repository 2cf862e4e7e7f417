"""From a session to training samples: synchronise, resample, find rests (paper 1, 3.2 and 3.3)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from calibrator.clock_shift import estimate_shift, interpolate, jumps
from calibrator.models.domain import Domain
from calibrator.places import folds, judged_places, revisited
from calibrator.samples import Samples
from calibrator.temperatures import rates_at, readings_at
from stage_core import topics
from stage_core.arrays import Array
from stage_core.clocks import to_seconds
from stage_core.errors import StageError
from stage_core.rests import REFERENCE_BAND, find_rests
from stage_core.session import Session

INPUTS = ('reference', 'encoder')
TARGETS = ('tracker', 'encoder', 'reference')

REST_DURATION = 0.08
"""A pause shorter than this [s] is a turning point, not a measurement at rest."""
FEWEST_POINTS = 4
"""Fewer points than this at the end of a rest do not tell their scatter."""
TRAVEL_SCATTER = 8.0
"""Points further from the end of a rest than this many standard deviations are travel."""
TRAVEL_LEAST = 5e-6
"""Points nearer to the end of a rest than this [m] are never taken for travel."""
ENOUGH_RESTS = 8
"""With fewer rests than this a session is used as a stream of moving points."""
MOST_STREAM_SAMPLES = 4000
FEWEST_PLACES = 5
"""With fewer distinct places, even a gain at every one of them could be chance (1 of 32 signs)."""
SHARE = 0.7
"""Of the places or the time that a model is trained on, as in the papers."""
FEWEST_HELD = 8
"""Held-out places from which one draw tells the gain."""
MOST_SESSION_FITS = 4
"""Sessions are held out in so many groups at most: each costs a fit."""


def prepare(session: Session, source: str = 'reference', target: str = 'tracker') -> Samples:
    """Training samples of a session.

    Rests are preferred: the mean of the measured points while the command stands, with the
    direction from which each axis came. A session without rests gives the points of the moving
    stage, the command interpolated to the measured stamps, both after the estimated clock shift.

    Parameters
    ----------
    source
        Model input: `reference` (what was commanded) or `encoder`.
    target
        Model output: `tracker` (aligned table points), `encoder` or `reference`.

    Raises
    ------
    StageError
        If a topic is missing, the two hold no common time, or a temperature sensor dropped out.
    """
    if source not in INPUTS or target not in TARGETS:
        raise StageError(
            f'a model takes {" or ".join(INPUTS)} and gives {", ".join(TARGETS)}; '
            f'got {source} and {target}'
        )
    axes = session.axes
    times, command = _stage_series(session, source, axes)
    measured_times, measured = _target_series(session, target, axes)
    same_clock = target != 'tracker'
    shift = 0.0
    motion = None if same_clock else _motion(session, times, command, axes)
    if motion is not None:
        shift = estimate_shift(*motion, measured_times, measured)
    measured_times = measured_times - shift
    directions = _directions(session, source, axes, command)
    rests = find_rests(times, command, REST_DURATION)
    samples = _rest_samples(times, command, directions, measured_times, measured, rests)
    at_rest = len(samples[0]) >= ENOUGH_RESTS
    if not at_rest:
        samples = _stream_samples(times, command, directions, measured_times, measured)
    sample_times, sample_command, sample_measured, direction = samples
    if len(sample_times) == 0:
        raise StageError(
            f'{session.path}: no measured point falls into the commanded time: check the clocks '
            'of the tracker and the stage'
        )
    sensors, temperatures = readings_at(session, sample_times)
    rates = rates_at(session, sample_times) if sensors else None
    return Samples(
        sample_command,
        sample_measured,
        direction,
        temperatures,
        sample_times,
        sensors,
        axes,
        shift,
        at_rest,
        rates,
    )


def require_rests(samples: Samples, target: str) -> None:
    """Raise a StageError where the points are those of a moving stage, and the tracker's."""
    if target == 'tracker' and not samples.at_rest:
        raise StageError(
            f'this is no calibration: the stage rested at fewer than {ENOUGH_RESTS} places, and '
            'the error of a moving stage is the lag of its servo; record a grid of rests '
            '(examples/calibrate_stage.py), or learn the tracking error with target encoder'
        )


def rest_samples(session: Session) -> tuple[Samples, NDArray[np.int64]]:
    """Means over the finished rests of a session, and the stamps [ns] (n,) at which they ended.

    For use while the stage runs: there is no search for a clock shift, since a rest lasts far
    longer than a clock that is off. May be empty.
    """
    times, command = _stage_series(session, 'reference', session.axes)
    measured_times, measured = _target_series(session, 'tracker', session.axes)
    directions = _directions(session, 'reference', session.axes, command)
    rests = [rest for rest in find_rests(times, command, REST_DURATION) if rest[1] < len(times)]
    t, c, m, d = _rest_samples(times, command, directions, measured_times, measured, rests)
    last = np.array([stop - 1 for _, stop in rests], dtype=np.int64)
    ended = session.series[topics.REFERENCE].stamps[last[np.searchsorted(times[last], t)]]
    sensors, heat = readings_at(session, t) if len(t) else ((), np.empty((0, 0)))
    return Samples(c, m, d, heat, t, sensors, session.axes, 0.0, True), ended


def splits(samples: Samples, seed: int = 0, by: str = 'position') -> list[tuple[Samples, Samples]]:
    """Pairs of training and held-out samples that a method is judged on.

    Parameters
    ----------
    by
        `position`: distinct places are drawn at random, and all visits to one stay together, so
        that no held-out place has been seen. Where one draw would hold out fewer than
        `FEWEST_HELD` places, each place is held out once, in up to that many pairs. `time`: the
        last part of the session is held out, which does not flatter where the stage drifts.
        `session`: each of several sessions is held out once, in up to `MOST_SESSION_FITS` groups,
        at the places that the others know; no pair where there is one session. `half`: the same
        for the earlier and the later half of the samples; see `told_apart` for what they tell.

    Raises
    ------
    StageError
        If there are too few distinct places or samples.
    """
    if by == 'time':
        count = int(round(SHARE * len(samples)))
        late = np.zeros(len(samples), dtype=bool)
        late[np.argsort(samples.times, kind='stable')[count:]] = True
        masks = [late]
    elif by == 'position':
        labels = judged_places(samples.command)
        drawn = np.random.default_rng(seed).permutation(int(labels.max()) + 1)
        if len(drawn) < FEWEST_PLACES:
            raise StageError(
                f'{len(samples)} samples at {len(drawn)} distinct places are too few to hold some '
                f'out: record more positions, {FEWEST_PLACES} places or more (a grid, as '
                'examples/calibrate_stage.py drives it)'
            )
        held = drawn[int(round(SHARE * len(drawn))) :]
        many = len(held) >= FEWEST_HELD
        masks = [np.isin(labels, held)] if many else folds(labels, FEWEST_HELD, seed)
    elif by in ('session', 'half'):
        apart = _halves(samples.times) if by == 'half' else samples.session
        if apart is None or len(np.unique(apart)) < 2:
            return []
        masks = folds(apart, MOST_SESSION_FITS, seed)
        pairs = [(samples.take(~m), known) for m in masks if len(known := _known(samples, m))]
        return [] if by == 'half' and not _enough(pairs) else pairs
    else:
        raise StageError(f'samples are split by position, time, session or half, not by {by}')
    if any(mask.all() or not mask.any() for mask in masks):
        raise StageError(
            f'{len(samples)} samples are too few to hold some out: record more positions'
        )
    return [(samples.take(~mask), samples.take(mask)) for mask in masks]


def told_apart(halves: list[tuple[Samples, Samples]]) -> bool:
    """Whether the pairs of `splits` by half tell a drift from an error of the stage.

    Only places that were visited in both halves do: along the border of two halves of a raster
    that is run once, a drift looks like an error that goes on.
    """
    again = [revisited(held.command, rest.command) for rest, held in halves]
    return _enough([(r, h.take(m)) for (r, h), m in zip(halves, again, strict=True) if m.any()])


def _enough(pairs: list[tuple[Samples, Samples]]) -> bool:
    """Whether of each half enough places are held out."""
    counts = [len(np.unique(judged_places(held.command))) for _, held in pairs]
    return len(counts) == 2 and min(counts) >= FEWEST_HELD


def _halves(times: Array) -> NDArray[np.int64]:
    """Label (n,) of the earlier and the later half of the samples."""
    label = np.zeros(len(times), dtype=np.int64)
    label[np.argsort(times, kind='stable')[len(times) // 2 :]] = 1
    return label


def _known(samples: Samples, held: NDArray[np.bool_]) -> Samples:
    """The held samples at places that the rest knows; elsewhere no model predicts anything."""
    rest, chosen = samples.take(~held), samples.take(held)
    domain = Domain.of(rest.command, rest.measured - rest.command, rest.temperatures)
    return chosen.take(domain.knows(chosen.command))


def approach_direction(command: Array) -> Array:
    """Sign of each axis' last move at each sample, (n, axes); 0 before the first one."""
    sign = last_moves(np.diff(command, axis=0, prepend=command[:1]), 0.0)
    last = np.where(sign != 0.0, np.arange(len(command))[:, None], 0)
    np.maximum.accumulate(last, axis=0, out=last)
    return np.take_along_axis(sign, last, axis=0)


def last_moves(step: Array, before: Array | float) -> Array:
    """Signs of steps [m]; of an axis that stands, the sign `before`."""
    return np.where(np.abs(step) >= REFERENCE_BAND, np.sign(step), before)


def _directions(session: Session, source: str, axes: tuple[str, ...], command: Array) -> Array:
    """Signs (n, axes) of the last moves, told by what was heard live: it begins amid a motion."""
    topic = topics.REFERENCE if source == 'reference' else topics.JOINT_STATES
    if f'direction.{axes[0]}' in session.series[topic].values:
        return session.series[topic].columns('direction', axes)
    return approach_direction(command)


def _rest_samples(
    times: Array,
    command: Array,
    directions: Array,
    measured_times: Array,
    measured: Array,
    rests: list[tuple[int, int]],
) -> tuple[Array, Array, Array, Array]:
    moves = np.any(directions != 0.0, axis=0)
    rows = []
    for start, stop in rests:
        if (moves & (directions[stop - 1] == 0.0)).any():
            # Before an axis' first move its play is open to either side.
            continue
        # The second half of a rest: the stage has settled by then.
        begin, end = 0.5 * (times[start] + times[stop - 1]), times[stop - 1]
        first, last = np.searchsorted(measured_times, [begin, end])
        first += _still_moving(measured_times[first:last], measured[first:last])
        if last > first:
            point = measured[first:last].mean(axis=0)
            rows.append((0.5 * (begin + end), command[stop - 1], point, directions[stop - 1]))
    if not rows:
        empty = np.empty((0, command.shape[1]))
        return np.empty(0), empty, empty, empty
    t, c, m, d = zip(*rows, strict=True)
    return np.array(t), np.array(c), np.array(m), np.array(d)


def _still_moving(times: Array, measured: Array) -> int:
    """How many of the points (n, axes) [m] were taken before the stage arrived.

    A stepper's reference stands from the moment of the command, while the stage still travels:
    what lies further from the last points than their scatter allows is travel.
    """
    tail = measured[times >= times[-1] - REST_DURATION] if len(times) else measured
    if len(tail) < FEWEST_POINTS:
        return 0
    allowed = np.maximum(TRAVEL_SCATTER * tail.std(axis=0), TRAVEL_LEAST)
    far = np.any(np.abs(measured - np.median(tail, axis=0)) > allowed, axis=1)
    return int(np.flatnonzero(far)[-1]) + 1 if far.any() else 0


def _stream_samples(
    times: Array, command: Array, directions: Array, measured_times: Array, measured: Array
) -> tuple[Array, Array, Array, Array]:
    inside = np.flatnonzero((measured_times >= times[0]) & (measured_times <= times[-1]))
    if len(inside) > MOST_STREAM_SAMPLES:
        inside = inside[np.linspace(0, len(inside) - 1, MOST_STREAM_SAMPLES).astype(int)]
    t = measured_times[inside]
    before = np.maximum(np.searchsorted(times, t, side='right') - 1, 0)
    return (
        t,
        interpolate(t, times, command),
        measured[inside],
        directions[before],
    )


def _stage_series(session: Session, quantity: str, axes: tuple[str, ...]) -> tuple[Array, Array]:
    topic = topics.REFERENCE if quantity == 'reference' else topics.JOINT_STATES
    series = session.require(topic, f'holds the {quantity}')
    return to_seconds(series.stamps, session.start_ns), series.columns('position', axes)


def _motion(
    session: Session, times: Array, command: Array, axes: tuple[str, ...]
) -> tuple[Array, Array] | None:
    """What the tracker's clock is compared with: the command, or a stepper's counted travel.

    A stepper's reference jumps to the target when a move is sent: its travel is no clock error.
    Told from the motion itself, because live data and foreign bags hold no twin; the unit of the
    counted travel (steps or metres) does not matter to the affine fit. None where the reference
    jumps and the travel is not known: nothing tells the time then.
    """
    counted = None
    if session.has(topics.JOINT_STATES):
        counted = _stage_series(session, 'encoder', axes)
    return counted if jumps(times, command, counted) else (times, command)


def _target_series(session: Session, target: str, axes: tuple[str, ...]) -> tuple[Array, Array]:
    if target != 'tracker':
        return _stage_series(session, target, axes)
    points = session.table_points()[:, : len(axes)]
    return session.seconds(topics.TRACKER_POINT), points
