"""Sessions made of random arrays, and processes that end with their test."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from stage_core import topics
from stage_core.frames import RigidTransform
from stage_core.session import Series, Session

from ..node_process import end

START = 1_700_000_000_123_456_789


def random_session(
    count: int = 500, seed: int = 0, axes: tuple[str, ...] = ('x', 'y'), effort: bool = True
) -> Session:
    """A session of every numeric topic; `count` ticks of 1 ms."""
    rng = np.random.default_rng(seed)
    stamps = START + np.arange(count) * 1_000_000

    def joint(*quantities: str) -> dict[str, np.ndarray]:
        return {f'{q}.{axis}': rng.normal(size=count) for q in quantities for axis in axes}

    series = {
        topics.REFERENCE: Series(topics.REFERENCE, stamps, joint('position', 'velocity')),
        topics.JOINT_STATES: Series(topics.JOINT_STATES, stamps, joint('position', 'velocity')),
        topics.COMMAND: Series(
            topics.COMMAND, stamps, joint('velocity', *(['effort'] if effort else []))
        ),
    }
    setpoint = joint('position', 'velocity')
    for axis in axes:
        setpoint[f'position.{axis}'][1::3] = np.nan
    series[topics.SETPOINT] = Series(topics.SETPOINT, stamps, setpoint)
    slow = stamps[::10]
    for topic in (topics.TRACKER_POINT, topics.CONTOUR_ERROR):
        columns = {axis: rng.normal(size=len(slow)) for axis in 'xyz'}
        series[topic] = Series(topic, slow, columns)
    wrench = {f'{p}.{a}': rng.normal(size=len(slow)) for p in ('force', 'torque') for a in 'xyz'}
    series[topics.CONTACT_FORCE] = Series(topics.CONTACT_FORCE, slow, wrench)
    for sensor in ('screw_x', 'air'):
        values = {
            'temperature': rng.normal(20, 1, size=len(slow)),
            'variance': np.zeros(len(slow)),
        }
        series[topics.temperature_key(sensor)] = Series(topics.TEMPERATURE, slow, values)
    alignment = RigidTransform.from_quaternion([0.1, 0.2, -0.3, 0.9], [1.0, -2.0, 0.5])
    twin = {'kind': 'servo', 'control_period': 0.001, 'axes': {a: {'mass': 8.0} for a in axes}}
    return Session('random', series, twin, alignment)


def assert_same(one: Session, other: Session) -> None:
    """The same topics, stamps, columns and alignment, bit for bit."""
    assert one.series.keys() == other.series.keys()
    for key, series in one.series.items():
        np.testing.assert_array_equal(series.stamps, other.series[key].stamps, err_msg=key)
        assert series.values.keys() == other.series[key].values.keys(), key
        for name, column in series.values.items():
            np.testing.assert_array_equal(column, other.series[key].values[name], err_msg=key)
    assert (one.alignment is None) == (other.alignment is None)
    if one.alignment is not None and other.alignment is not None:
        np.testing.assert_allclose(
            one.alignment.rotation, other.alignment.rotation, rtol=0, atol=1e-14
        )


@pytest.fixture
def start_process(ros_env: dict[str, str]) -> Iterator[Callable[..., subprocess.Popen[str]]]:
    """Start Python code or a module's main in the test's graph; ended with the test."""
    started: list[subprocess.Popen[str]] = []

    def start(code: str, *arguments: str, **options: object) -> subprocess.Popen[str]:
        process = subprocess.Popen(
            [sys.executable, '-c', code, *arguments],
            env={**ros_env, 'PYTHONUNBUFFERED': '1'},
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            **options,  # type: ignore[call-overload]
        )
        started.append(process)
        return process

    yield start
    for process in started:
        print(end(process))


RECORDER = 'from session_bags.recorder_node import main; main()'
PLAYER = 'from session_bags.player_node import main; main()'


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    """A finished bag of half a second."""
    from session_bags.writer import write_session

    return write_session(tmp_path / 'bag', random_session())
