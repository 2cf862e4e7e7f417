"""A drive whose ticks scatter: what it reads late, and how long its forces are held."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from gap_diagnosis.input.data import Record, load_record
from gap_diagnosis.input.noise import AxisNoise, Noise
from gap_diagnosis.residuals.late_ticks import forces_as_held, read_in_time
from gap_diagnosis.residuals.low_pass import smooth
from stage_core.session import Session
from stage_core.twin_file import TwinFile
from stage_twin.effects.encoder_interpolation import misreading

Maker = Callable[..., Session]

STD = 5e-5  # s, of the moments of reading
MASS, VISCOUS = 12.0, 40.0


def scattered(acts_late: bool) -> tuple[Record, np.ndarray]:
    """A drive on a sine that answers each misread position; its record and its true positions.

    The motion is exact: the forces are what it needs, and reactions to the misread speed. Where
    the drive acts late, the controller's slow part takes up what those do over uneven ticks.
    """
    period, n = 1e-3, 20000
    t = period * np.arange(n)
    late = STD * np.random.default_rng(3).standard_normal(n)
    q = 0.05 * np.sin(2 * np.pi * 0.7 * t)
    v = np.gradient(q, period)
    read = q + v * late
    reaction = -800.0 * v * np.diff(late, prepend=0.0) / period
    needed = MASS * np.gradient(v, period) + VISCOUS * v
    held = 1.0 + np.diff(late, append=0.0) / period
    force = needed + reaction
    if acts_late:
        force = force - smooth(force * (held - 1.0), period, 10.0)
    noise = Noise((AxisNoise(1e-7, STD, 0.1, 1e-7),))
    return (
        Record(
            name='sine',
            axes=('x',),
            period=period,
            time=t,
            reference=q[:, None],
            reference_velocity=v[:, None],
            velocity_command=v[:, None],
            force=force[:, None],
            encoder=read[:, None],
            temperature=None,
            tracker_time=None,
            tracker=None,
            noise=noise,
        ),
        q,
    )


def viscous_left(record: Record, force: np.ndarray) -> float:
    """Viscous friction [N s/m] that a force needs beyond the machine's."""
    v = np.gradient(record.reference[:, 0], record.period)
    rest = force - MASS * np.gradient(v, record.period) - VISCOUS * v
    inner = slice(500, -500)
    return float(rest[inner] @ v[inner] / (v[inner] @ v[inner]))


@pytest.mark.parametrize('acts_late', [True, False])
def test_forces_that_were_held_longer_count_for_more(acts_late: bool) -> None:
    record, _ = scattered(acts_late)
    recorded = viscous_left(record, record.force[:, 0])
    assert abs(recorded) == pytest.approx(2.0 if acts_late else 0.0, abs=0.3)
    assert viscous_left(record, forces_as_held(record, 0, MASS, VISCOUS)) == pytest.approx(
        0.0, abs=0.3
    )


def test_positions_are_those_of_the_ticks() -> None:
    record, true = scattered(acts_late=False)
    inner = slice(500, -500)
    before = np.std((record.encoder[:, 0] - true)[inner])
    after = np.std((read_in_time(record).encoder[:, 0] - true)[inner])
    assert after < 0.3 * before


def test_a_wave_that_the_encoder_reads_is_no_late_tick() -> None:
    plain, true = scattered(acts_late=False)
    values = {'amplitude': 5e-6, 'period': 3e-4, 'phase': 0.4}
    wave = misreading(true, values)
    waves = {'encoder_interpolation.x': {name: (v, 0.0) for name, v in values.items()}}
    record = replace(plain, encoder=plain.encoder + wave[:, None], waves=waves)
    kept = (read_in_time(record).encoder - read_in_time(plain).encoder)[500:-500, 0]
    assert kept @ wave[500:-500] == pytest.approx(wave[500:-500] @ wave[500:-500], rel=0.03)


def test_a_record_without_scatter_stays_as_it_is(planted: Maker) -> None:
    record = load_record(planted({}, duration=10.0), TwinFile.nominal_servo())
    assert read_in_time(record) is record
    quiet = replace(record, noise=None)
    assert forces_as_held(quiet, 0, MASS, VISCOUS) is not None
    assert np.array_equal(forces_as_held(quiet, 0, MASS, VISCOUS), quiet.force[:, 0])
