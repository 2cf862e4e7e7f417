"""Whether the numbers of a session can be in SI units, and of one clock."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from stage_core import topics
from stage_core.quantities import AXES
from stage_core.session import Series, Session
from stage_core.tracker_frame import other_unit, turned

#: No precision stage travels this far [m], or this fast [m/s]; no tracker sees this far [m].
_LONGEST_TRAVEL = 10.0
_HIGHEST_SPEED = 20.0
_LONGEST_SIGHT = 200.0
#: A laboratory [°C].
_COLDEST, _WARMEST = -40.0, 120.0
#: A simulation slower than this took its messages from two clocks instead (ratio, and hours [s]).
_SLOWEST_SIMULATION = 100.0
_LONG_RECORDING = 3600.0
#: An encoder that moves less [m] while the tracker measures, or fewer points, tell no frame.
_LEAST_TRAVEL, _FEWEST_POINTS = 1e-4, 10


def check_units(series: Mapping[str, Series]) -> Iterator[tuple[str, str]]:
    """Yield (topic, what looks wrong)."""
    for key, part in series.items():
        for name, column in part.values.items():
            finite = column[np.isfinite(column)]
            largest = float(np.abs(finite).max(initial=0.0))
            if name.startswith('position.') and largest > _LONGEST_TRAVEL:
                yield key, f'{name} reaches {largest:.4g}: positions are in metres'
            if name.startswith('velocity.') and largest > _HIGHEST_SPEED:
                yield key, f'{name} reaches {largest:.4g}: velocities are in m/s'
            if part.topic == topics.TRACKER_POINT and largest > _LONGEST_SIGHT:
                yield key, f'{name} reaches {largest:.4g}: points are in metres'
            outside = np.any((finite < _COLDEST) | (finite > _WARMEST))
            if name == 'temperature' and outside:
                yield key, f'{finite.max():.4g} is no room temperature in °C'
        if part.topic in (topics.REFERENCE, topics.JOINT_STATES):
            yield from _check_derivative(key, part)
    yield from _check_follows(series)


def check_tracker(session: Session) -> tuple[str, str]:
    """What is wrong with the unit, and with the frame, of the points of a tracker; or empty."""
    if not (session.has(topics.TRACKER_POINT) and session.has(topics.JOINT_STATES)):
        return '', ''
    if any(_check_follows(session.series)):
        return '', ''  # of the encoder that is said already
    encoder = session.series[topics.JOINT_STATES]
    axes = [axis for axis in AXES if f'position.{axis}' in encoder.values]
    if not axes:
        return '', ''  # the encoder names no axis, which is said already
    points, stamps = session.table_points(), session.series[topics.TRACKER_POINT].stamps
    together = (stamps >= encoder.stamps[0]) & (stamps <= encoder.stamps[-1])
    points, stamps = points[together], stamps[together]
    positions = np.array(
        [np.interp(stamps, encoder.stamps, encoder.values[f'position.{axis}']) for axis in axes]
    ).T
    known = np.isfinite(points).all(axis=1) & np.isfinite(positions).all(axis=-1)
    points, positions = points[known], positions[known]
    if len(points) < _FEWEST_POINTS or np.ptp(positions, axis=0).max() < _LEAST_TRAVEL:
        return '', ''
    if unit := other_unit(points, positions, 'the encoder'):
        return unit, ''
    return '', turned(points[:, [AXES.index(axis) for axis in axes]], positions)


def check_times(series: Mapping[str, Series], arrivals: float) -> Iterator[tuple[str, str]]:
    """Yield (topic, what looks wrong) where a bag mixes clocks.

    Parameters
    ----------
    arrivals
        Time between the first and the last arrival of any message [s].
    """
    reference = series.get(topics.REFERENCE)
    if reference is None or not len(reference):
        return
    first, last = reference.stamps[0], reference.stamps[-1]
    for key, part in series.items():
        if part.topic in topics.LATCHED or not len(part):
            continue
        if part.stamps[-1] < first or part.stamps[0] > last:
            text = f'is stamped {(part.stamps[0] - first) * 1e-9:.6g} s from the reference'
            yield key, f'{text}, and never together with it: stamp with one clock'
    span = (last - first) * 1e-9
    if arrivals > _LONG_RECORDING + _SLOWEST_SIMULATION * span:
        text = f'messages arrived over {arrivals:.6g} s, the reference took {span:.6g} s'
        yield 'arrival', f'{text}: a node has another clock than the rest (use_sim_time)'


def _check_derivative(key: str, part: Series) -> Iterator[tuple[str, str]]:
    """The velocity must be the derivative of the position, to a factor of ten."""
    seconds = (part.stamps - part.stamps[0]) * 1e-9 if len(part) else np.array([])
    if len(part) < 20 or seconds[-1] <= 0:
        return
    for axis in AXES:
        position = part.values.get(f'position.{axis}')
        velocity = part.values.get(f'velocity.{axis}')
        if position is None or velocity is None:
            continue
        # Path lengths: insensitive to noise of one sample, and to where the time starts.
        path = float(np.nansum(np.abs(np.diff(position))))
        covered = float(np.nansum(np.abs(velocity[:-1]) * np.diff(seconds)))
        if min(path, covered) > 1e-4 and not 0.1 < covered / path < 10.0:
            ratio = covered / path
            text = f'velocity.{axis} is {ratio:.3g} times the derivative of the position'
            yield key, f'{text}: check the units'


def _check_follows(series: Mapping[str, Series]) -> Iterator[tuple[str, str]]:
    """The encoder must travel about as far as the reference."""
    if topics.REFERENCE not in series or topics.JOINT_STATES not in series:
        return
    reference, encoder = series[topics.REFERENCE], series[topics.JOINT_STATES]
    for axis in AXES:
        name = f'position.{axis}'
        if name not in reference.values or name not in encoder.values:
            continue
        wanted = float(np.nanmax(reference.values[name]) - np.nanmin(reference.values[name]))
        seen = float(np.nanmax(encoder.values[name]) - np.nanmin(encoder.values[name]))
        if wanted > 1e-4 and not 0.1 < seen / wanted < 10.0:
            text = f'{name} travels {seen / wanted:.3g} times as far as the reference'
            yield topics.JOINT_STATES, f'{text}: check the units'
