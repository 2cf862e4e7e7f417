"""Ticks from stamps that jitter, jump or miss: counted, and the encoder decides at jumps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from gap_diagnosis.diagnose import diagnose
from gap_diagnosis.input.ticks import machine_clock, tick_numbers
from stage_core import topics
from stage_core.session import Series, Session
from stage_core.twin_file import TwinFile

Maker = Callable[..., Session]

PERIOD = 1e-3
STEP = np.array([1e-6])


def path(count: int) -> np.ndarray:
    """Encoder of strokes of 50 mm/s and dwells (count, 1) [m]."""
    t = np.arange(count) * PERIOD
    position = 0.02 * np.clip(2.0 * np.sin(2.0 * np.pi * t / 4.0), -1.0, 1.0)
    return 1e-6 * np.rint(position[:, None] / 1e-6)


def waits(count: int, seed: int = 0) -> np.ndarray:
    """Waits (count,) [s] that a busy machine adds before each tick: many short, a few long."""
    generator = np.random.default_rng(seed)
    share = generator.random(count)
    out = np.where(share < 0.3, generator.exponential(8e-4, count), 0.0)
    out += np.where(share > 0.995, generator.exponential(0.03, count), 0.0)
    out[0] = 0.0
    return out


def test_a_machine_that_waits_for_late_forces_is_counted() -> None:
    count = 20000
    seconds = np.arange(count) * PERIOD + np.cumsum(waits(count))
    numbers = tick_numbers(seconds, PERIOD, path(count), STEP)
    np.testing.assert_array_equal(numbers, np.arange(count))
    time, clock = machine_clock(seconds, numbers, PERIOD)
    assert clock is not None
    np.testing.assert_allclose(time, np.arange(count) * PERIOD, atol=1e-9)
    np.testing.assert_allclose(clock.to_machine(seconds), time, atol=1e-9)
    # Half a tick before a stamp the machine was half a tick from it, however long it had waited.
    np.testing.assert_allclose(
        clock.to_machine(seconds[1:] - 0.5 * PERIOD), time[1:] - 0.5 * PERIOD, atol=1e-9
    )
    np.testing.assert_allclose(clock.to_machine(clock.to_stamps(time)), time, atol=1e-9)


@pytest.mark.parametrize('jitter', [0.0, 5e-5])
def test_lost_ticks_are_gaps(jitter: float) -> None:
    generator = np.random.default_rng(2)
    kept = np.flatnonzero(generator.random(20000) > 0.02)
    kept = np.concatenate([[0], kept[kept > 0]])
    seconds = kept * PERIOD + jitter * generator.standard_normal(len(kept))
    numbers = tick_numbers(seconds, PERIOD, path(20000)[kept], STEP)
    np.testing.assert_array_equal(numbers, kept)
    time, clock = machine_clock(seconds, numbers, PERIOD)
    assert clock is None
    np.testing.assert_allclose(time, kept * PERIOD, atol=2e-5)


def test_late_stamps_and_a_slow_clock_are_neither_gaps_nor_waits() -> None:
    generator = np.random.default_rng(1)
    count = 20000
    late = np.where(generator.random(count) < 0.02, generator.uniform(0.0, 3e-3, count), 0.0)
    seconds = np.sort(np.arange(count) * PERIOD * 1.0002 + late)
    numbers = tick_numbers(seconds, PERIOD, path(count), STEP)
    np.testing.assert_array_equal(numbers, np.arange(count))
    time, clock = machine_clock(seconds, numbers, PERIOD)
    assert clock is None
    assert time[-1] - time[0] == pytest.approx((count - 1) * PERIOD * 1.0002, abs=1e-4)


@pytest.mark.parametrize('seed', range(4))
def test_stamps_that_jitter_widely_are_all_ticks(seed: int) -> None:
    generator = np.random.default_rng(seed)
    count = 60000
    jitter = np.clip(0.22e-3 * generator.standard_normal(count), -0.45e-3, 0.45e-3)
    seconds = np.arange(count) * PERIOD + jitter
    # At rest no encoder tells a late stamp from a lost tick.
    numbers = tick_numbers(seconds, PERIOD, np.zeros((count, 1)), STEP)
    np.testing.assert_array_equal(numbers, np.arange(count))
    assert machine_clock(seconds, numbers, PERIOD)[1] is None


def in_real_time(session: Session, latency: float = 0.0) -> Session:
    """The session of a machine whose time stands still for late forces, as on a busy computer."""
    stamps = session.series[topics.REFERENCE].stamps
    late = np.cumsum(waits(len(stamps)))
    ticks = (stamps - stamps[0]) * 1e-9

    def moved(own: np.ndarray) -> np.ndarray:
        # What lies between two ticks belongs to the later one.
        at = np.searchsorted(ticks, (own - stamps[0]) * 1e-9 - 1e-9)
        return own + np.rint(1e9 * late[np.minimum(at, len(late) - 1)]).astype(np.int64)

    series = {}
    for key, old in session.series.items():
        extra = np.int64(1e9 * latency) if key == topics.TRACKER_POINT else np.int64(0)
        series[key] = Series(old.topic, moved(old.stamps) + extra, old.values)
    return replace(session, series=series)


def test_planted_effects_are_named_in_a_session_in_real_time(planted: Maker) -> None:
    effects = {
        'backlash.x': {'width': 8e-6},
        'cyclic_pitch_error.y': {'amplitude': 3e-6, 'phase': 0.7},
        'nonorthogonality': {'angle': 80e-6},
        'coulomb_friction.x': {'coulomb': 6.0},
    }
    session = in_real_time(planted(effects, axes=('x', 'y')), latency=1.5e-3)
    found = diagnose([session], [], TwinFile.nominal_servo())
    assert set(found.verdict) == {*effects, 'tracker_latency'}
    assert found.parameters['tracker_latency']['latency'][0] == pytest.approx(1.5e-3, abs=5e-5)
    assert found.parameters['backlash.x']['width'][0] == pytest.approx(8e-6, rel=0.05)
    assert found.after < 1.5 * found.noise_floor
    # The report's windows are those of the bag's stamps.
    assert found.windows[-1][1] > 1.2 * found.records[0].duration
