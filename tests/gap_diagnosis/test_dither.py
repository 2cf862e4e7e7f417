"""A twin that sticks is run with the noise of its encoders."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from gap_diagnosis.closed_loop import dither
from gap_diagnosis.closed_loop.channels import chance_rms
from gap_diagnosis.closed_loop.replay import DRAWS, mean_square, replay, replays
from gap_diagnosis.closed_loop.rests import rest_notes, with_rests
from gap_diagnosis.diagnose import diagnose
from gap_diagnosis.input.data import Record, load_record
from stage_core import topics
from stage_core.arrays import Array
from stage_core.session import Series, Session
from stage_core.twin_file import TwinFile

from .conftest import nominal, reference

Maker = Callable[..., Session]

COULOMB, PRESLIDING, NOISE, SUBSTEPS = 15.0, 4e-6, 0.8e-6, 10


def rough(
    resolution: float = 1e-8, coulomb: float = COULOMB, presliding: float = PRESLIDING
) -> TwinFile:
    """A nominal twin that states a friction, with a fine encoder."""
    twin = nominal()
    fine = replace(twin.servo('x'), encoder_resolution=resolution)
    known = {'coulomb': coulomb, 'presliding': presliding}
    return replace(twin, axes={'x': fine}).with_effects({'coulomb_friction.x': known})


def run(
    twin: TwinFile,
    wanted: Array,
    rate: Array,
    noise: Array,
    presliding: float,
) -> tuple[Array, Array, Array]:
    """Readings, velocity commands and forces (n,) of the loop of interfaces.md, step by step."""
    axis, period = twin.servo('x'), twin.control_period
    coulomb = twin.effects['coulomb_friction.x']['coulomb']
    keep, short = np.exp(-period * axis.velocity_filter), period / SUBSTEPS
    position, speed, bristle = float(wanted[0]), 0.0, 0.0
    last, filtered, integral = position, 0.0, 0.0
    out = np.zeros((3, len(wanted)))
    for k in range(len(wanted)):
        step = axis.encoder_resolution
        reading = step * np.round((position + noise[k]) / step)
        filtered = keep * filtered + (1.0 - keep) * (reading - last) / period
        last = reading
        command = axis.position_gain * (wanted[k] - reading) + axis.velocity_feedforward * rate[k]
        force = axis.velocity_gain * (command - filtered) + integral
        integral += axis.integral_gain * period * (command - filtered)
        out[:, k] = reading, command, force
        for _ in range(SUBSTEPS):
            still = np.exp(-short * abs(speed) / presliding)
            bristle = still * bristle + (1.0 - still) * np.copysign(presliding, speed)
            friction = coulomb * bristle / presliding
            speed += short * (force - axis.viscous * speed - friction) / axis.mass
            position += short * speed
    return out[0], out[1], out[2]


def recorded(planted: Maker, twin: TwinFile, std: float, presliding: float) -> Session:
    """A session of that machine whose controller reads noise, made without the simulation."""
    path = reference(12.0, twin.control_period, 1)[:, 0]
    rate = np.gradient(path, twin.control_period)
    noise = std * np.random.default_rng(5).standard_normal(len(path))
    noise[0] = 0.0
    readings, commands, forces = run(twin, path, rate, noise, presliding)
    session = planted({})
    del session.series[topics.TRACKER_POINT]
    state, command = session.series[topics.JOINT_STATES], session.series[topics.COMMAND]
    assert len(state.stamps) == len(path)
    keys = {'position.x': readings}
    changed = Series(state.topic, state.stamps, {**state.values, **keys})
    told = {'velocity.x': commands, 'effort.x': forces}
    asked = Series(command.topic, command.stamps, {**command.values, **told})
    series = {topics.JOINT_STATES: changed, topics.COMMAND: asked}
    return replace(session, series={**session.series, **series})


@pytest.fixture(scope='module')
def noisy(planted: Maker) -> Session:
    """Its encoder shows the noise."""
    return recorded(planted, rough(), NOISE, PRESLIDING)


def left(record: Record, draw: int | None) -> float:
    """RMS of the gap of the encoder [m]."""
    return float(np.sqrt(np.mean(replay(record, rough(), {}, draw)['encoder.x'] ** 2)))


def test_a_machine_that_its_noise_shakes_is_followed_by_a_twin_with_noise(noisy: Session) -> None:
    record = load_record(noisy, rough())
    assert record.noise is not None
    assert record.noise.axes[0].position == pytest.approx(NOISE, rel=0.05)
    assert left(record, 0) < 3.0 * NOISE
    assert left(record, None) > 3.0 * left(record, 0)


def test_the_stated_friction_of_such_a_machine_is_no_gap(noisy: Session) -> None:
    found = diagnose([noisy], [], rough())
    assert found.verdict == []
    assert any('shakes it out of its friction' in note for note in found.warnings)


def test_no_loop_without_friction_is_shaken(noisy: Session) -> None:
    record = load_record(noisy, rough())
    plain = replace(rough(), effects={})
    both = [replay(record, plain, {}, draw)['encoder.x'] for draw in (0, None)]
    np.testing.assert_array_equal(*both)


def test_what_shakes_a_loop_is_what_its_reading_does(noisy: Session) -> None:
    """The loop without friction answers to the commands as to the noise of its readings."""
    record = load_record(noisy, rough())
    plain = replace(rough(), effects={})
    axis = replace(plain.servo('x'), encoder_resolution=dither.STEPLESS)
    moved, pushed = dither.answer(record, plain)
    assert 0.05 * NOISE < np.std(moved) < NOISE
    # The command differs from the force by what the integral holds alone.
    shaken = axis.velocity_gain * dither.shaking(record, plain)
    assert np.std(pushed - shaken) < 0.5 * np.std(pushed)


def test_two_runs_of_a_loop_that_sticks_differ_by_chance(noisy: Session) -> None:
    record = load_record(noisy, rough())
    apart = chance_rms([record], rough(), {}, ['x'])
    # As the machine differs from its own twin, up to the noise of its readings.
    assert 0.2 * NOISE < apart < 1.5 * left(record, 0)
    assert chance_rms([record], replace(rough(), effects={}), {}, ['x']) == 0.0


def test_the_gap_of_a_loop_that_sticks_is_the_mean_over_draws(noisy: Session) -> None:
    record = load_record(noisy, rough())
    runs = replays(record, rough(), {})
    assert len(runs) == DRAWS
    squares = [run['encoder.x'] ** 2 for run in runs]
    np.testing.assert_allclose(mean_square(runs, 'encoder.x'), np.mean(squares, axis=0))
    assert not np.array_equal(squares[0], squares[1])
    assert len(replays(record, replace(rough(), effects={}), {})) == 1


def test_a_machine_that_rests_without_presliding(planted: Maker) -> None:
    """Its twin's friction creeps under the noise of the encoder."""
    session = recorded(planted, rough(), 0.4 * NOISE, 0.005 * PRESLIDING)
    (record,) = with_rests([load_record(session, rough())], rough(), {})
    assert record.noise is not None and record.noise.axes[0].dry
    # Nobody asked for this axis, and without its friction it is run as usual.
    (other,) = with_rests([record], rough(), {}, ['y'])
    assert other.noise == record.noise
    (calm,) = with_rests([record], replace(rough(), effects={}), {})
    assert calm.noise is not None
    assert (calm.noise.axes[0].dry, calm.noise.axes[0].at_rest) == (False, None)
    found = diagnose([session], [], rough())
    assert found.verdict == []
    assert any('as with a dry friction' in note for note in found.warnings)


def test_noise_that_the_steps_of_an_encoder_hide(planted: Maker) -> None:
    firm, light = rough(0.5e-6, 40.0, 1e-6), rough(1e-6, 15.0, 0.5e-6)
    for twin, noise, hidden in ((firm, 0.05e-6, True), (light, 0.0, False)):
        presliding = twin.effects['coulomb_friction.x']['presliding']
        record = load_record(recorded(planted, twin, noise, presliding), twin)
        (own,) = with_rests([record], twin, {})
        assert own.noise is not None and not own.noise.axes[0].beyond_steps
        assert bool(own.noise.axes[0].at_rest) is hidden
        assert bool(rest_notes(own)) is hidden
        # Which noise the steps hide is not known: two runs differ by chance, also where none is.
        assert chance_rms([record], twin, {}, ['x']) > 0.01 * twin.servo('x').encoder_resolution


def test_a_twin_that_diverges_is_far_from_the_record_and_no_infinity(
    planted: Maker, recwarn: pytest.WarningsRecorder
) -> None:
    axis = nominal().servo('x')
    wild = replace(nominal(), axes={'x': replace(axis, mass=-axis.mass, force_limit=1e300)})
    record = load_record(planted({}, duration=6.0), nominal())
    gaps = replay(record, wild, {})
    assert all(np.all(np.isfinite(gap**2)) for gap in gaps.values())
    assert max(np.abs(gap).max() for gap in gaps.values()) > 1.0
    assert np.isfinite(chance_rms([record], wild, {}, ['x']))
    assert not recwarn.list
