"""A wave that an encoder reads over its own position, told from its readings alone."""

import math
from dataclasses import replace

import numpy as np
import pytest

from gap_diagnosis.closed_loop.channels import gap_channels
from gap_diagnosis.closed_loop.encoder_waves import with_waves_of_loop
from gap_diagnosis.closed_loop.misread import misread
from gap_diagnosis.diagnose import diagnose
from gap_diagnosis.evidence.describe import describe
from gap_diagnosis.input.data import load_record
from gap_diagnosis.input.noise import axis_noise
from gap_diagnosis.input.reading_wave import _positive, reading_wave, without_wave
from gap_diagnosis.parameters import plain_values
from stage_core import topics
from stage_twin.effects import EFFECTS
from stage_twin.effects.encoder_interpolation import misreading
from tests.gap_diagnosis.conftest import nominal

PERIOD, STEP = 0.001, 0.1e-6
TIME = np.arange(30000) * PERIOD
WHOLE = np.ones(len(TIME), dtype=bool)
#: Strokes at speeds of 0 to 60 mm/s.
MOTION = 0.04 * np.sin(2.0 * np.pi * 0.2 * TIME) + 0.005 * np.sin(2.0 * np.pi * 0.31 * TIME)
WAVE = {'amplitude': 1.2e-6, 'period': 40e-6, 'phase': 0.7, 'amplitude_2': 0.4e-6, 'phase_2': -1.1}


def test_amplitudes_are_positive_and_the_wave_is_the_same():
    odd = {'amplitude': 2e-6, 'period': 40e-6, 'phase': 7.0, 'amplitude_2': -3e-7, 'phase_2': 1.0}
    plain = _positive(odd)
    assert min(plain.values()) > -math.pi and plain['amplitude_2'] == 3e-7
    assert misreading(MOTION, plain) == pytest.approx(misreading(MOTION, odd), abs=1e-15)


def read(position, noise=0.1e-6, step=STEP):
    white = noise * np.random.default_rng(4).standard_normal(len(position))
    return step * np.round((position + white) / step)


def test_a_wave_is_found_with_its_harmonics():
    found = reading_wave(read(MOTION + misreading(MOTION, WAVE)), PERIOD, WHOLE, STEP)
    assert found['period'][0] == pytest.approx(WAVE['period'], rel=1e-5)
    for name, value in WAVE.items():
        assert abs(found[name][0] - value) <= 2.0 * found[name][1] + 1e-9, name
    assert found['amplitude_3'][0] < 0.02e-6


def test_noise_and_jitter_are_what_is_left_without_the_wave():
    reading = read(MOTION + misreading(MOTION, WAVE))
    found = {n: v for n, (v, _) in reading_wave(reading, PERIOD, WHOLE, STEP).items()}
    taken_for_noise = axis_noise(reading, PERIOD, STEP, WHOLE)
    noise = axis_noise(without_wave(reading, PERIOD, found), PERIOD, STEP, WHOLE)
    assert noise.jitter == 0.0 and noise.position == pytest.approx(0.104e-6, rel=0.2)
    assert math.hypot(taken_for_noise.position, 0.05 * taken_for_noise.jitter) > 0.5e-6


def late(position):
    """Read at moments that scatter by 40 µs."""
    delay = 40e-6 * np.random.default_rng(5).standard_normal(len(position))
    return position - np.gradient(position, PERIOD) * delay


def forced(position):
    """What a force of the position makes of it: the less the faster it is passed."""
    omega = 2.0 * np.pi * np.abs(np.gradient(position, PERIOD)) / 300e-6
    return position + 0.4 * np.sin(2.0 * np.pi * position / 300e-6) / (100.0 + omega) ** 2


def shaken(position):
    """Shaken 90 times a second, wherever it is."""
    return position + 1e-6 * np.sin(2.0 * np.pi * 90.0 * TIME)


@pytest.mark.parametrize('motion', [np.array, late, forced, shaken])
def test_nothing_else_is_taken_for_a_wave(motion):
    assert reading_wave(read(motion(MOTION)), PERIOD, WHOLE, STEP) == {}


def test_steps_are_no_wave():
    strokes = 0.04 * (2.0 * np.abs((0.3 * TIME) % 1.0 - 0.5) - 0.5)  # at one speed
    for step in (1e-6, 20e-6):
        assert reading_wave(read(strokes, 0.0, step), PERIOD, WHOLE, step) == {}


def test_an_axis_at_rest_or_too_slow_tells_nothing():
    assert reading_wave(read(0.0 * MOTION), PERIOD, WHOLE, STEP) == {}
    assert reading_wave(read(1e-3 * MOTION), PERIOD, WHOLE, STEP) == {}


@pytest.mark.parametrize(('period', 'amplitude'), [(50e-6, 1.5e-6), (200e-6, 3e-6)])
def test_a_session_without_a_tracker_names_it(planted, period, amplitude):
    wave = {'amplitude': amplitude, 'period': period, 'phase': 0.5}
    session = planted({'encoder_interpolation.x': wave})
    series = {k: v for k, v in session.series.items() if k != topics.TRACKER_POINT}
    found = diagnose([replace(session, series=series)], [], nominal())
    assert found.verdict == ['encoder_interpolation.x']
    for name, (value, deviation) in found.parameters['encoder_interpolation.x'].items():
        assert abs(value - wave.get(name, 0.0)) <= 2.0 * deviation, name
    assert found.after < 1.1 * found.noise_floor


@pytest.mark.parametrize(('period', 'amplitude'), [(50e-6, 1.5e-6), (200e-6, 3e-6)])
def test_the_loop_tells_a_wave_better_than_the_readings(planted, period, amplitude):
    """The readings hold the loop's answer to the wave."""
    name = 'encoder_interpolation.x'
    session = planted({name: {'amplitude': amplitude, 'period': period, 'phase': 0.5}})
    record = load_record(session, nominal())
    (refined,) = with_waves_of_loop([record], nominal())
    read, told = (abs(r.waves[name]['amplitude'][0] - amplitude) for r in (record, refined))
    assert told < 0.02 * amplitude and told < read


def test_what_tracker_and_encoder_both_show_is_one_wave(planted):
    name, wave = 'encoder_interpolation.x', {'amplitude': 3e-6, 'period': 200e-6, 'phase': 0.5}
    found = diagnose([planted({name: wave})], [], nominal())
    (tracker,) = (p for p in found.parts if p.name == 'tracker')
    seen = describe(tracker.selection, tracker.selector.regression)
    assert found.verdict == [name]
    # The tracker sees it where the loop follows it, too: what it shows is told.
    assert found.parameters[name] == seen[name]
    for shown in (seen, found.records[0].waves):
        for key, truth in wave.items():
            value, deviation = shown[name][key]
            assert abs(value - truth) <= 3.0 * deviation, key
    assert found.after < 0.5 * found.before


@pytest.mark.parametrize(
    ('period', 'same', 'more'),
    [
        (1.0001e-3, True, {}),
        (1.02e-3, False, {}),
        (1.02e-3, False, {'growth': 0.3, 'centre': 0.0, 'half_range': 0.02}),
        (1.02e-3, False, {'wave_amplitude1': 3e-7, 'wave_period1': 2e-3, 'wave_phase1': 0.1}),
    ],
)
def test_a_wave_of_the_table_that_the_encoder_reads_already_is_the_encoders(
    planted, period, same, more
):
    twin = nominal()
    values = {'amplitude': 1.2e-6, 'period': 1e-3, 'phase': 0.7}
    record = load_record(planted({'encoder_interpolation.x': values}), twin)
    twice = {k: (v, 1e-9) for k, v in {**values, 'period': period, **more}.items()}
    named = {
        'encoder_interpolation.x': {k: (v, 1e-9) for k, v in values.items()},
        'cyclic_pitch_error.x': twice,
    }
    channels = gap_channels([record], twin, plain_values(named), [])
    floors = dict.fromkeys(channels, 1e-7)
    assert (misread([record], twin, named, channels, floors) is not None) is same


def test_an_encoder_may_misread_any_wave_that_a_table_may_have():
    table, encoder = EFFECTS['cyclic_pitch_error'], EFFECTS['encoder_interpolation']
    for known in table.parameters:
        if known.name.startswith('amplitude'):
            assert encoder.parameter(known.name).maximum >= known.maximum
