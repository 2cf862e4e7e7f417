"""Noise beside a controller that is not the twin's: other gains, and what no gains explain."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from gap_diagnosis.input.data import Record, load_record
from gap_diagnosis.input.noise import AxisNoise, Noise
from gap_diagnosis.residuals.commands import controller_findings
from gap_diagnosis.residuals.control_law import filtered, force_increments, velocity_law
from gap_diagnosis.residuals.recording import in_newtons
from stage_core.session import Session
from stage_core.twin_file import TwinFile

from .conftest import nominal
from .test_controller import other_gains

Maker = Callable[..., Session]


def noisy(
    session: Session,
    twin: TwinFile,
    reads_it: bool = True,
    effort: float = 0.0,
    size: float = 5e-6,
) -> Record:
    """A record with noise of its encoder [m], commanded by the nominal law; of its effort [N].

    The controller `reads_it`, or another draw of the noise.
    """
    record = load_record(session, twin)
    draws = np.random.default_rng(1).normal(0.0, size, (2, *record.encoder.shape))
    read, recorded = record.encoder + draws[0], record.encoder + draws[1 - reads_it]
    true, reading = TwinFile.nominal_servo().servo('x'), replace(record, encoder=read)
    speeds = velocity_law(replace(reading, velocity_command=np.full_like(read, np.nan)), 0, true)
    forces = np.cumsum(np.append(0.0, force_increments(reading, 0, true, speeds)))
    forces += np.random.default_rng(2).normal(0.0, effort, len(forces)) if effort else 0.0
    own = AxisNoise(size, 0.0, effort, true.encoder_resolution)
    return replace(
        record,
        encoder=recorded,
        velocity_command=speeds[:, None],
        force=forces[:, None],
        noise=Noise((own,)),
    )


def test_the_corner_of_a_filter_shows_through_the_noise_of_an_effort(planted: Maker) -> None:
    # At low frequencies it makes less of both gains, as another unit does.
    corner = TwinFile.nominal_servo().servo('x').velocity_filter / 1.18
    twin = other_gains({'velocity_filter': corner})
    made = noisy(planted({}, duration=10.0), twin, effort=0.5)
    assert in_newtons([made], twin, ())[1] == {}
    found, _ = controller_findings([made], twin)
    (gains,) = found.values()
    assert list(gains) == ['velocity_filter_error']
    error, deviation = gains['velocity_filter_error']
    assert abs(error - 0.18) < 3.0 * deviation < 0.05
    nominal = TwinFile.nominal_servo()
    assert controller_findings(
        [noisy(planted({}, duration=10.0), nominal, effort=0.5)], nominal
    ) == ({}, ())


@pytest.mark.parametrize('reads_the_record', [True, False])
def test_noise_hides_no_other_gain_where_the_controller_read_what_is_recorded(
    planted: Maker, reads_the_record: bool
) -> None:
    twin = other_gains({'integral_gain': 0.8 * TwinFile.nominal_servo().servo('x').integral_gain})
    made = noisy(planted({}, duration=10.0), twin, reads_the_record)
    found, _ = controller_findings([made], twin)
    told = {'integral_gain_error': pytest.approx((0.25, 0.0), abs=1e-6)}
    assert found == ({'controller_mismatch.x': told} if reads_the_record else {})


@pytest.mark.parametrize(('grows', 'noise'), [(0.0, 0.0), (0.0, 0.05), (0.5, 0.0), (0.5, 0.05)])
def test_a_gain_that_grows_with_the_error_is_no_law_of_the_twin(
    planted: Maker, grows: float, noise: float
) -> None:
    """With other gains alone nothing is left, however noisy the effort is [N]."""
    record = load_record(planted({}, duration=10.0), nominal())
    true = nominal().servo('x')
    error = record.reference[:, 0] - record.encoder[:, 0]
    scale = float(np.sqrt(np.mean(error**2)))
    gain = 1.3 * true.position_gain * (1.0 + grows * error**2 / (error**2 + scale**2))
    speeds = gain * error + true.velocity_feedforward * record.reference_velocity[:, 0]
    forces = np.cumsum(force_increments(record, 0, true, speeds))
    forces += np.random.default_rng(3).normal(0.0, noise, len(forces)) if noise else 0.0
    made = replace(
        record,
        velocity_command=speeds[:, None],
        force=np.concatenate([[0.0], forces])[:, None],
    )
    told, unlike = controller_findings([made], nominal())
    assert set(told) == {'controller_mismatch.x'}
    assert unlike == (('x',) if grows else ())


@pytest.mark.parametrize('falls', [0.0, 0.7])
def test_gains_that_fall_near_no_error_are_no_law_of_the_twin(
    planted: Maker, falls: float
) -> None:
    """What they leave of the forces is as fast as the noise that the controller read."""
    made = noisy(planted({}, duration=10.0), nominal(), size=5e-7)
    true = nominal().servo('x')
    error = made.velocity_command[:, 0] - filtered(made, 0, true.velocity_filter)
    scale = float(np.sqrt(np.mean(error**2)))
    error *= 0.8 * (1.0 - falls / (1.0 + (error / scale) ** 2))
    forces = true.velocity_gain * error + true.integral_gain * made.period * np.cumsum(error)
    told, unlike = controller_findings([replace(made, force=forces[:, None])], nominal())
    assert 'controller_mismatch.x' in told
    assert unlike == (('x',) if falls else ())
