"""Synthetic sessions with a known stage, for the tests of this folder."""

import numpy as np
import pytest

from stage_core import topics
from stage_core.session import Series, Session

EPOCH = 1_700_000_000_000_000_000


def _planted_map(command, direction):
    """Scale, squareness, a 4 mm screw cycle and backlash: about 20 um over 50 mm."""
    x, y = command.T
    return (
        np.column_stack(
            [
                x * (1 + 3e-4) - 2e-4 * y + 4e-6 * np.sin(2 * np.pi * x / 0.004),
                y * (1 - 2e-4) + 0.02 * (x - 0.025) ** 2,
            ]
        )
        + 0.5 * direction * 10e-6
    )


def _grid_session(points=60, latency=0.0, rest=0.3, seed=0, noise=3e-7, sensor=None, twin=None):
    """Moves between random points with rests; tracker at 100 Hz stamped late by `latency` [s]."""
    generator = np.random.default_rng(seed)
    goals = generator.uniform(0.0, 0.05, (points, 2))
    period = 0.002
    pieces, at = [np.zeros((50, 2))], np.zeros(2)
    for goal in goals:
        steps = max(int(np.abs(goal - at).max() / (0.2 * period)), 2)
        ramp = (1 - np.cos(np.linspace(0, np.pi, steps))) / 2
        pieces += [at + ramp[:, None] * (goal - at), np.tile(goal, (int(rest / period), 1))]
        at = goal
    reference = np.vstack(pieces)
    step = np.diff(reference, axis=0, prepend=reference[:1])
    direction = np.zeros_like(reference)
    for axis in range(2):
        last = 0.0
        for i, d in enumerate(step[:, axis]):
            last = np.sign(d) if abs(d) > 1e-9 else last
            direction[i, axis] = last
    table = _planted_map(reference, direction)
    every = 5
    stamps = EPOCH + np.rint(np.arange(len(reference)) * period * 1e9).astype(np.int64)
    measured = table[::every] + generator.normal(0, noise, table[::every].shape)
    series = {
        topics.REFERENCE: Series(
            topics.REFERENCE,
            stamps,
            {'position.x': reference[:, 0], 'position.y': reference[:, 1]},
        ),
        topics.TRACKER_POINT: Series(
            topics.TRACKER_POINT,
            stamps[::every] + int(latency * 1e9),
            {'x': measured[:, 0], 'y': measured[:, 1], 'z': np.zeros(len(measured))},
        ),
    }
    if sensor is not None:
        key = topics.temperature_key('screw_x')
        values = np.resize(np.asarray(sensor, float), len(stamps[::500]))
        series[key] = Series(key, stamps[::500], {'temperature': values})
    return Session('synthetic', series, twin)


@pytest.fixture(scope='session')
def planted_map():
    """Table point of a command and its direction of approach."""
    return _planted_map


@pytest.fixture(scope='session')
def grid_session():
    """Maker of sessions of the planted stage."""
    return _grid_session
