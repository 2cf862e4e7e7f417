"""Sensor effects: frame, latency and clock of the tracker, the encoder's quantum."""

from dataclasses import replace

import numpy as np
import pytest

from stage_core.twin_file import TrackerSpec, TwinFile
from stage_twin.simulate import simulate
from stage_twin.tracker import sample_path

TIMES = np.arange(1201) * 1e-3


def run(effects, twin=None, **options):
    twin = (twin or TwinFile.nominal_servo()).with_effects(effects)
    reference = np.stack([0.02 * np.sin(4.0 * TIMES), 0.01 * TIMES], axis=1)
    rate = np.gradient(reference, 1e-3, axis=0)
    return simulate(twin, reference, rate, **{'noise': False, **options})


def test_nominal_tracker_shows_the_table():
    result = run({})
    assert len(result.tracker_stamps) == 121
    np.testing.assert_allclose(result.tracker_stamps, np.arange(121) * 0.01)
    np.testing.assert_allclose(result.tracker_points[:, :2], result.table[::10], atol=1e-16)
    assert not result.tracker_points[:, 2].any()


def test_misalignment_rotates_by_plus_angle_then_shifts():
    values = {'angle': 0.3, 'offset_x': 1.0, 'offset_y': -2.0}
    result = run({'tracker_misalignment': values})
    # As complex numbers: e^(i angle) p + offset.
    table = result.table[::10, 0] + 1j * result.table[::10, 1]
    expected = np.exp(0.3j) * table + (1.0 - 2.0j)
    np.testing.assert_allclose(result.tracker_points[:, 0], expected.real, atol=1e-14)
    np.testing.assert_allclose(result.tracker_points[:, 1], expected.imag, atol=1e-14)


def test_latency_makes_points_older_than_their_stamps():
    result = run({'tracker_latency': {'latency': 0.007}})
    np.testing.assert_allclose(result.tracker_stamps, np.arange(121) * 0.01)
    np.testing.assert_allclose(result.tracker_points[1:, :2], result.table[3::10], atol=1e-12)
    np.testing.assert_array_equal(result.tracker_points[0, :2], result.table[0])


def test_clock_drift_stretches_the_stamps():
    result = run({'tracker_clock_drift': {'drift': 5e-4}})
    np.testing.assert_allclose(result.tracker_stamps, np.arange(121) * 0.01 * 1.0005)
    np.testing.assert_allclose(result.tracker_points[:, :2], result.table[::10], atol=1e-11)


def test_points_at_given_stamps_are_those_of_the_drifting_clock():
    effects = {'tracker_clock_drift': {'drift': 5e-4}, 'tracker_latency': {'latency': 0.003}}
    own = run(effects)
    asked = run(effects, tracker_times=own.tracker_stamps)
    np.testing.assert_array_equal(asked.tracker_points, own.tracker_points)


def test_the_encoder_reads_falsely_within_each_period_of_its_scale():
    twin = TwinFile.nominal_servo()
    fine = replace(
        twin, axes={a: replace(v, encoder_resolution=1e-12) for a, v in twin.axes.items()}
    )
    values = {'amplitude': 3e-6, 'period': 1e-4, 'phase': 0.7, 'amplitude_2': 1e-6, 'phase_2': 2.0}
    result = run({'encoder_interpolation.x': values}, fine)
    angle = 2.0 * np.pi * result.table[:, 0] / 1e-4
    read = 3e-6 * np.sin(angle + 0.7) + 1e-6 * np.sin(2.0 * angle + 2.0)
    np.testing.assert_allclose(result.encoder[:, 0] - result.table[:, 0], read, atol=1e-11)
    # The controller follows what it reads: the table goes wrong by it, not the encoder.
    assert np.abs(result.table[:, 0] - run({}, fine).table[:, 0]).max() > 1e-6


def test_encoder_quantisation_takes_the_place_of_the_resolution():
    result = run({'encoder_quantisation.x': {'resolution': 7e-6}})
    steps = result.encoder[:, 0] / 7e-6
    np.testing.assert_allclose(steps, np.rint(steps), atol=1e-9)
    assert np.abs(result.encoder[:, 0] - result.table[:, 0]).max() <= 3.5e-6 + 1e-12
    fine = result.encoder[:, 1] / 1e-6
    np.testing.assert_allclose(fine, np.rint(fine), atol=1e-8)


def test_noise_has_the_file_s_deviation_and_its_own_seed():
    twin = replace(TwinFile.nominal_servo(), tracker=TrackerSpec(rate=1000.0, noise=2e-6))
    clean = run({}, twin)
    noisy = run({}, twin, noise=True, seed=4)
    deviation = (noisy.tracker_points - clean.tracker_points).std(axis=0)
    # Three standard errors of a standard deviation from 1201 values.
    np.testing.assert_allclose(deviation, 2e-6, rtol=3.0 / np.sqrt(2.0 * 1201))
    np.testing.assert_array_equal(
        noisy.tracker_points, run({}, twin, noise=True, seed=4).tracker_points
    )
    other = run({}, twin, noise=True, seed=5)
    assert not np.array_equal(noisy.tracker_points, other.tracker_points)
    np.testing.assert_array_equal(noisy.encoder, other.encoder)


def test_a_twin_without_a_tracker_has_no_points():
    result = run({}, replace(TwinFile.nominal_servo(), tracker=None))
    assert result.tracker_stamps.shape == (0,)
    assert result.tracker_points.shape == (0, 3)


@pytest.mark.parametrize('offset', [0.0, 0.00025, 0.0009])
def test_interpolation_between_ticks_is_exact_for_parabolas(offset):
    ticks = np.arange(50) * 1e-3
    path = (3.0 * ticks**2 - 0.2 * ticks)[:, None]
    asked = ticks[2:-3] + offset
    np.testing.assert_allclose(
        sample_path(path, 1e-3, asked)[:, 0], 3.0 * asked**2 - 0.2 * asked, atol=1e-15
    )
