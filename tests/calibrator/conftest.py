"""Synthetic sessions with a known stage, for the tests of this folder."""

import numpy as np
import pytest

from stage_core import topics
from stage_core.drive_link import SENSORS
from stage_core.session import Series, Session, by_topic
from stage_core.twin_file import TwinFile
from stage_twin.kinematics import carry

EPOCH = 1_700_000_000_000_000_000
WARM = TwinFile.nominal_servo().with_effects(
    {'thermal_expansion.x': {'coefficient': 23e-6}, 'thermal_expansion.y': {'coefficient': 12e-6}}
)


def _planted_map(command, direction):
    """Scale, squareness, a 4 mm screw cycle and backlash: about 20 µm over 50 mm."""
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


def make_grid_session(
    points=60, latency=0.0, rest=0.3, seed=0, noise=3e-7, sensor=None, twin=None, places=None
):
    """Moves between random points with rests; tracker at 100 Hz stamped late by `latency` [s].

    With `places`, so many points are visited again and again.
    """
    generator = np.random.default_rng(seed)
    goals = generator.uniform(0.0, 0.05, (places or points, 2))
    goals = np.resize(goals, (points, 2))
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
    series = by_topic(
        Series.per_axis(topics.REFERENCE, stamps, position=reference),
        Series.points(topics.TRACKER_POINT, stamps[::every] + int(latency * 1e9), measured),
    )
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
    return make_grid_session


@pytest.fixture
def warm_stage():
    """Table point (2,) of the warm twin for a command (2,) [m] and screw temperatures [degC]."""

    def table_point(command, screws):
        heat = np.array([screws])
        return carry(WARM, command[None], heat)[0]

    return table_point


@pytest.fixture
def warming_session():
    """Twin whose screws warm by 4 and 3 K while it visits 90 points for 5 s each, at 10 Hz."""
    generator = np.random.default_rng(0)
    goals = generator.uniform(-0.04, 0.04, (90, 2))
    command = np.repeat(goals, 50, axis=0)
    times = 0.1 * np.arange(len(command))
    warming = 1.0 - np.exp(-times / 150.0)
    screws = 20.0 + np.column_stack([4.0 * warming, 3.0 * np.sin(times / 100.0) ** 2])
    table = carry(WARM, command, screws)
    table = table + generator.normal(0.0, 2e-7, table.shape)
    stamps = 10**18 + (times * 1e9).astype(np.int64)
    series = by_topic(
        Series.per_axis(topics.REFERENCE, stamps, position=command),
        Series.points(topics.TRACKER_POINT, stamps, table),
    )
    for i, sensor in enumerate(SENSORS):
        key = topics.temperature_key(sensor)
        # Frame and air stay: sensors that tell nothing are left out of the model.
        values = screws[::10, i] if i < 2 else np.full(len(stamps[::10]), 20.0)
        series[key] = Series(topics.TEMPERATURE, stamps[::10], {'temperature': values})
    return Session('warming', series)
