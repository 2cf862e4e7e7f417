"""The page of a diagnosis: what stands out of the corrected twin is named, not passed over."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from gap_diagnosis.closed_loop.channels import Channel, axis_shares
from gap_diagnosis.evidence.describe import not_seen
from gap_diagnosis.evidence.judgement import channel_floor
from gap_diagnosis.report.causes import causes_section, effect_sentence, parameter_words
from gap_diagnosis.report.experiment import section
from gap_diagnosis.report.hysteresis import hysteresis, hysteresis_plot, since_reversal
from gap_diagnosis.report.leftovers import leftovers
from gap_diagnosis.report.page import _lacks, _unexplained
from gap_diagnosis.report.response import response_plot, responses
from stage_core.pages import Page
from stage_core.twin_file import TwinFile


def beside(after: np.ndarray) -> Any:
    """A diagnosis of one encoder channel at 1 kHz whose reference turns at 1 s and at 3 s."""
    time = 1e-3 * np.arange(len(after))
    position = 0.01 * np.abs(((time + 1.0) % 4.0) - 2.0)
    record = SimpleNamespace(
        axes=('x',), time=time, reference=position[:, None], held_out_session=False
    )
    channel = Channel('encoder.x', 'm', [time], [2.0 * after], [after])
    return SimpleNamespace(
        channels={'encoder.x': channel}, records=[record], twin=TwinFile.nominal_servo(),
        structured=False, unexplained=0.024,
    )  # fmt: skip


def found_in(after: np.ndarray) -> Any:
    """Its leftovers."""
    return leftovers(beside(after))


def test_spikes_after_a_reversal_are_found_and_noise_is_not() -> None:
    noise = 0.3e-6 * np.random.default_rng(0).standard_normal(4000)
    assert found_in(noise) == []
    spikes = noise.copy()
    spikes[1050:1060] += 15e-6
    spikes[2000:2005] -= 12e-6
    (found,) = found_in(spikes)
    assert (found.channel, found.count, found.after_reversal) == ('encoder.x', 2, 1)
    assert abs(found.largest - 15e-6) < 1.5e-6
    np.testing.assert_allclose(found.times, [1.055, 2.0], atol=0.01)
    quiet = '2.4 % of the squared gap, without structure'
    assert _unexplained(beside(noise)) == quiet
    assert _unexplained(beside(spikes)) == f'{quiet}, with short events, see below'


def test_a_count_of_the_encoder_is_no_event() -> None:
    counts = np.zeros(4000)
    counts[::400] = 1e-6
    assert found_in(counts) == []


def test_an_axis_has_its_share_of_the_squared_gaps_above_the_floor() -> None:
    twin = TwinFile.nominal_servo()
    channels = {}
    for name, gap in {'encoder.x': 2e-6, 'encoder.y': 0.0, 'tracker.y': 4e-6}.items():
        rows = [np.full(3, np.hypot(gap, channel_floor(twin, name)))]
        channels[name] = Channel(name, 'm', [], rows, [])
    shares, link = axis_shares(('x', 'y'), channels, twin)
    np.testing.assert_allclose([shares['x'], shares['y']], [0.2, 0.8])
    assert link == 'kinematic'


def test_travel_begins_anew_at_each_reversal_and_noise_is_none() -> None:
    position = 1e-6 * np.array([0.0, 1.0, 0.0, 20.0, 19.0, 21.0, 15.0, 5.0, 4.0, 30.0])
    travel, direction = since_reversal(position)
    np.testing.assert_array_equal(direction, [0, 0, 0, 1, 1, 1, -1, -1, -1, 1])
    np.testing.assert_allclose(1e6 * travel[[3, 5, 6, 8, 9]], [20, 21, 6, 17, 26])


def strokes() -> Any:
    """Strokes at 1 kHz: friction of 6 N, play of 8 µm, a loop of 10 Hz; a twin with none."""
    time = 1e-3 * np.arange(24_000)
    reference = 0.01 * np.abs(((time + 1.0) % 4.0) - 2.0)
    encoder = np.zeros_like(reference)
    for tick in range(1, len(time)):
        lag = reference[tick - 1] - encoder[tick - 1]
        encoder[tick] = encoder[tick - 1] + 2e-3 * np.pi * 10.0 * lag
    way = np.sign(np.gradient(encoder))
    zero = np.zeros_like(time)
    gaps = {'encoder.x': (0.1 * (encoder - reference), 'm'), 'force.x': (6.0 * way, 'N'),
            'tracker.x': (-4e-6 * way, 'm')}  # fmt: skip
    record = SimpleNamespace(
        axes=('x',), time=time, period=1e-3, reference=reference[:, None],
        encoder=encoder[:, None], held_out_session=False, column=lambda _: 0,
    )  # fmt: skip
    return SimpleNamespace(
        channels={n: Channel(n, unit, [time], [g], [zero]) for n, (g, unit) in gaps.items()},
        records=[record],
    )


def test_friction_and_play_are_the_branches_of_the_hysteresis() -> None:
    force, tracker = found = hysteresis(strokes())
    for item, size in ((force, 6.0), (tracker, -4e-6)):
        forwards, backwards = np.nanmedian(item.before, axis=1)
        np.testing.assert_allclose([forwards, backwards], [size, -size])
        assert np.nanmax(np.abs(item.after)) == 0.0
    assert len(hysteresis_plot(found).axes) == 2


def test_the_response_has_the_bandwidth_of_the_loop() -> None:
    (found,) = responses(strokes())
    at = np.interp(10.0, found.frequency, np.abs(found.machine))
    assert abs(at - np.sqrt(0.5)) < 0.05
    np.testing.assert_allclose(found.corrected, found.machine)
    assert len(response_plot([found]).axes) == 2


def test_a_motion_that_decides_nothing_is_not_proposed() -> None:
    pair = (('cyclic_pitch_error.y: amplitude_2 small', 'large'), 0.0, 0.0)
    found = SimpleNamespace(
        causes=[],
        verdict=('cyclic_pitch_error.y',),
        experiment=SimpleNamespace(
            pairs=(pair,), expected=0.0, before=0.0, separates=('cyclic_pitch_error.y',),
            library=[], duration=14.0, motions=('a sweep',),
        ),
    )  # fmt: skip
    page = Page('next')
    section(page, found)  # type: ignore[arg-type]
    assert 'the amplitude of harmonic 2 in cyclic pitch error of y' in page.render()
    assert 'experiment.csv' not in page.render()
    found.experiment.expected = 0.6
    section(page, found)  # type: ignore[arg-type]
    assert 'experiment.csv' in page.render()
    found.experiment.pairs = ()
    found.experiment.library = [('backlash.x', 0.2, 0.9), ('drive_play.x', 0.5, 0.5)]
    page = Page('hidden')
    section(page, found)  # type: ignore[arg-type]
    shown = page.render()
    assert 'does not show some effects' in shown and 'backlash of x' in shown


def test_an_effect_that_is_rather_not_there_is_named_apart() -> None:
    found = SimpleNamespace(
        simulators=[],
        verdict=['backlash.x', 'tracker_misalignment'],
        causes=[
            SimpleNamespace(effect='backlash.x', probability=0.96),
            SimpleNamespace(effect='tracker_misalignment', probability=0.494),
        ],
    )
    assert _lacks(found) == (  # type: ignore[arg-type]
        'The twin lacks (in brackets: probability) backlash of x (0.96). '
        'Kept, though its probability is below a half: tracker misalignment (0.49).'
    )


def cause(effect: str, probability: float, status: str) -> Any:
    """A candidate without rivals."""
    return SimpleNamespace(
        effect=effect, probability=probability, status=status, alternatives=(), shrink=0.5,
        interval=(0.4, 0.6), parameters={},
    )  # fmt: skip


def test_an_unlikely_candidate_is_named_and_has_no_row() -> None:
    kept = cause('backlash.x', 0.96, 'accepted')
    kept.parameters = {'width': (8e-6, 1e-7)}
    causes = [
        kept,
        cause('drive_gain.x', 0.4, 'below_noise'),
        cause('drive_gain.y', 0.003, 'below_noise'),
        *(cause(name, 0.002, 'rejected') for name in ('cable_force.x', 'unknown', 'none')),
    ]
    page = Page('evidence')
    causes_section(page, SimpleNamespace(causes=causes))  # type: ignore[arg-type]
    text = page.render()
    assert text.count('<tr>') == 3
    assert (
        '<li>too small to tell: drive gain of y.</li><li>rejected: cable force of x.</li>' in text
    )


def test_the_sentence_names_the_offset_that_is_no_chance() -> None:
    found = {'angle': (-7e-6, 6e-6), 'offset_x': (9e-8, 2.4e-7), 'offset_y': (-7.6e-7, 1.9e-7)}
    said = effect_sentence('tracker_misalignment', found)
    assert said.endswith('; the angle may be zero; with offset y \u22120.76 ± 0.19 µm')


def test_a_parameter_that_nothing_shows_is_said_to_be_unseen() -> None:
    rocks = {
        'frequency': (25.0, 0.1),
        'damping': (0.04, 0.01),
        'mass_ratio': (0.0, 0.0),
        'table_share': (-1.2, 0.1),
    }
    assert not_seen('structural_resonance.x', rocks) == ['mass_ratio']
    assert 'mass ratio not seen' in parameter_words('structural_resonance.x', rocks)
    assert 'not seen: mass ratio' in effect_sentence('structural_resonance.x', rocks)
    seen = rocks | {'mass_ratio': (0.0, 0.02)}
    assert not_seen('structural_resonance.x', seen) == []
    read = {'factor': (-1.0, 1e-9), 'magnitude': (0.0, 0.0)}
    assert not_seen('effort_convention.x', read) == []
