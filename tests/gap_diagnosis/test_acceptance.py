"""What a name has to show before it stands in a report."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from gap_diagnosis.evidence import judgement
from gap_diagnosis.evidence.acceptance import (
    Shrink,
    Sides,
    refuted,
    shows,
    shrink_of,
    untold,
)
from gap_diagnosis.evidence.causes import _refuted, _told_by_balance

from .conftest import nominal

PLAY = {'width': (8e-6, 1e-7)}


def shrink(before: float, after: float, low: float, unit: str = 'm') -> Shrink:
    return Shrink(unit, before, after, (low, 1.0), floor=1e-6, least=0.1)


@pytest.mark.parametrize(
    ('found', 'stands'),
    [
        (shrink(3e-6, 1e-6, 0.5), True),
        (shrink(3e-6, 1e-6, -0.01), False),  # by chance
        (shrink(1.05e-6, 1e-6, 0.02), False),  # nobody would see it
        (shrink(50e-6, 49e-6, 0.01), True),  # little of a large gap, and much beside the noise
        (shrink(1.2, 1.1, 0.05, unit='N'), False),
        (shrink(1.2, 0.8, 0.2, unit='N'), True),
    ],
)
def test_a_name_stands_only_where_the_gap_shrinks_by_it(found: Shrink, stands: bool) -> None:
    assert refuted('backlash.x', found, PLAY) is not stands


def test_a_name_that_makes_a_channel_worse_goes() -> None:
    found = Shrink('m', 3e-6, 1e-6, (0.5, 0.7), 1e-6, 0.1, worse=('encoder.y',))
    assert refuted('backlash.x', found, PLAY)


@pytest.mark.parametrize(
    ('low', 'worse', 'stands'),
    [(0.5, (), True), (0.5, ('tracker.x',), False), (-1e-4, (), False)],
)
def test_a_frame_that_was_taken_out_before_shrinks_the_gap_and_makes_no_channel_worse(
    low: float, worse: tuple[str, ...], stands: bool
) -> None:
    name, found = 'tracker_misalignment', Shrink('m', 3e-6, 1e-6, (low, 0.7), 1e-6, 0.0, worse)
    part = SimpleNamespace(rows=None, problem=SimpleNamespace(before={name: np.zeros(9)}))
    values = {'angle': (4e-3, 1e-5)}
    assert _refuted(name, [part], found, values, nominal(('x', 'y'))) is not stands


@pytest.mark.parametrize('width', [(1e-7, 1e-7), (1e-3, 1e-6)])
def test_a_parameter_at_nothing_or_at_its_bound_is_no_finding(width: tuple[float, float]) -> None:
    assert refuted('backlash.x', shrink(3e-6, 1e-6, 0.5), {'width': width})


@pytest.mark.parametrize(('backwards', 'stands'), [(0.37, False), (0.5, True)])
def test_a_friction_that_is_the_same_in_both_directions_is_not_asymmetric(
    backwards: float, stands: bool
) -> None:
    values = {'coulomb_positive': (0.38, 0.05), 'coulomb_negative': (backwards, 0.06)}
    viscous = {'viscous_positive': (0.7, 1.5), 'viscous_negative': (0.8, 1.1)}
    found = shrink(3e-6, 1e-6, 0.5)
    assert refuted('asymmetric_friction.y', found, {**values, **viscous}) is not stands


@pytest.mark.parametrize(('coulomb', 'another'), [(5.15, False), (5.5, True)])
def test_a_stated_friction_is_another_one_only_beyond_four_deviations(
    coulomb: float, another: bool
) -> None:
    """No law of a friction is that of a machine to the letter."""
    values = {'coulomb': (coulomb, 0.05)}
    assert untold('coulomb_friction.x', values, {'coulomb': 5.0}) is not another
    assert not untold('coulomb_friction.x', {'coulomb': (0.15, 0.05)})


def test_the_noise_of_other_channels_hides_no_effect() -> None:
    noise = np.random.default_rng(0).normal(0.0, 1.3e-6, (4, 6000)) ** 2
    moved = np.abs(np.sin(np.linspace(0.0, 60.0, 6000))) * 4e-12
    sides = {'encoder.x': Sides(noise[0] + moved, noise[0], 'm', 1.3e-6)}
    for channel, same in zip(('encoder.y', 'tracker.x', 'tracker.y'), noise[1:], strict=True):
        sides[channel] = Sides(same, same, 'm', 1.3e-6)
    found = shrink_of('axis_crosstalk.x', sides, seed=0)
    assert found.share < 0.2  # of all positions together, as the report says
    assert found.matters


@pytest.mark.parametrize(('closed', 'stands'), [(1.5, True), (0.5, False)])
def test_what_closes_more_than_the_noise_of_one_channel_is_seen(
    closed: float, stands: bool
) -> None:
    """A wave of an encoder of 44 nm of noise beside a tracker of 1.9 µm."""
    quiet, loud = np.full(6000, 44e-9**2), np.full(6000, 1.9e-6**2)
    sides = {
        'encoder.y': Sides((1.0 + closed) * quiet, quiet, 'm', 44e-9),
        'tracker.y': Sides(loud, loud, 'm', 1.9e-6),
    }
    assert shrink_of('encoder_interpolation.y', sides, seed=0).matters is stands


@pytest.mark.parametrize(
    ('closed', 'explained', 'stands'),
    [(0.004, False, False), (0.02, False, True), (0.004, True, True)],
)
def test_what_closes_nearly_nothing_of_its_axis_is_the_error_of_other_models(
    closed: float, explained: bool, stands: bool
) -> None:
    left, gap = np.full(6000, 9e-12), 5e-10
    encoder = Sides(left + closed * gap, left, 'm', 1e-6, gap)
    other = Sides(left, left, 'm', 1e-6, 1e-12)
    sides = {'encoder.x': encoder, 'encoder.y': other}
    calm = ['encoder.x'] if explained else []
    assert shrink_of('coulomb_friction.x', sides, 0, calm).matters is stands


@pytest.mark.parametrize(
    ('left', 'balance', 'stands'),
    [(4e-12, 0.3, False), (1.2e-12, 0.3, True), (4e-12, 0.95, True)],
)
def test_what_was_most_of_what_was_lacking_may_be_little_of_the_gap(
    left: float, balance: float, stands: bool
) -> None:
    after, gap = np.full(6000, left), 5e-10
    encoder = Sides(after + 0.005 * gap, after, 'm', 1e-6, gap)
    found = shrink_of('base_resonance.x', {'encoder.x': encoder}, 0, balance=balance)
    assert found.matters is stands


@pytest.mark.parametrize(('balance', 'stands'), [(0.3, False), (0.95, True)])
def test_what_explains_the_balance_of_an_axis_without_other_gaps_may_move_it_little(
    balance: float, stands: bool
) -> None:
    """A lag in the steps of an encoder: the gap shrinks for certain, but by 4 % only."""
    after = np.full(6000, 1e-12)
    encoder = Sides(1.08 * after, after, 'm', 1e-6, 1.08e-12)
    found = shrink_of(
        'current_loop_lag.x', {'encoder.x': encoder}, 0, ['encoder.x'], False, balance
    )
    assert found.matters is stands


@pytest.mark.parametrize(('closed', 'stands'), [(0.05, False), (0.3, True)])
def test_what_the_noise_hides_is_no_error_of_the_table(closed: float, stands: bool) -> None:
    left = np.full(6000, 1e-12)
    sides = {'tracker.x': Sides(left * (1.0 + closed), left, 'm', 1e-6)}
    assert shrink_of('cyclic_pitch_error.x', sides, seed=0).matters is stands


@pytest.mark.parametrize('twice', [True, False])
def test_a_swing_that_the_tracker_shows_too_needs_no_tenth_of_the_gap(twice: bool) -> None:
    """Of a tracker of 2 µm of noise a swing of 0.8 µm takes 0.04 and is there for certain."""
    noise = np.random.default_rng(1).normal(0.0, 2e-6, 20000)
    swing = 1.1e-6 * np.sin(np.linspace(0.0, 5000.0, 20000))
    sides = {'tracker.x': Sides((noise + swing) ** 2, noise**2, 'm', 2e-6, 5e-12)}
    found = shrink_of('structural_resonance.x', sides, seed=0, shown_twice=twice)
    assert found.matters is twice


def test_noise_that_the_loop_answers_is_no_structure() -> None:
    rng = np.random.default_rng(3)
    noise = rng.normal(0.0, 0.55e-6, 20_000)
    answered = noise + 0.5 * np.convolve(noise, np.ones(8) / 8.0, mode='same')
    floor = 1e-6 / np.sqrt(12.0)
    assert np.sqrt(np.mean(answered**2)) > 1.9 * floor
    assert not shows(answered, floor)
    slow = 0.8e-6 * np.sin(2.0 * np.pi * 5.0 * 1e-3 * np.arange(20_000))
    assert shows(slow + noise, floor)
    assert not shows(0.2 * slow, floor)


def test_the_rounding_of_a_slow_axis_is_no_structure() -> None:
    """Tracker less encoder of an axis that takes ten points for each step of 20 µm."""
    step, rows = 20e-6, np.ones(5000, dtype=bool)
    position = step * np.linspace(0.0, 500.0, 5000) ** 1.02
    left = position - step * np.round(position / step)
    left += np.random.default_rng(2).normal(0.0, 2e-6, 5000)
    floor = np.hypot(2e-6, step / np.sqrt(12.0))

    def structured(residual: np.ndarray, rounding: float) -> bool:
        problem = SimpleNamespace(held_out=rows, floor=floor, rounding=rounding, target=residual)
        none = np.zeros(5000)
        return judgement.structure(problem, residual, residual, none, 'tracker').structured

    assert structured(left, 0.0) and not structured(left, step**2 / 12.0)
    assert structured(left + 15e-6 * np.sin(0.01 * np.arange(5000)), step**2 / 12.0)


@pytest.mark.parametrize(('offset', 'structured'), [(0.0, True), (300e-6, False)])
def test_effects_that_make_up_for_one_another_hide_no_structure(
    offset: float, structured: bool
) -> None:
    """A wander is much of the gap, and little of an offset that was there before."""
    rows = np.ones(5000, dtype=bool)
    left = 9e-6 * np.sin(0.01 * np.arange(5000)) + np.random.default_rng(2).normal(0, 1e-6, 5000)
    problem = SimpleNamespace(held_out=rows, floor=1e-6, rounding=0.0, target=left + offset)
    none = np.zeros(5000)
    found = judgement.structure(problem, left, left + 300e-6, none, 'tracker')
    assert found.structured is structured


def test_a_force_that_has_no_gap_tells_of_no_effect() -> None:
    """The swing of a table that no force shows does not matter because the force is right."""
    nothing, noise = np.zeros(6000), np.full(6000, 1e-12)
    force = Sides(nothing, nothing, 'N', 0.1)
    sides = {'tracker.x': Sides(1.01 * noise, noise, 'm', 1e-6), 'force.x': force}
    assert not shrink_of('structural_resonance.x', sides, seed=0).matters


@pytest.mark.parametrize(('closed', 'stands'), [(0.8, True), (0.0, False)])
def test_what_wanders_before_the_tracker_hides_no_resonance_from_the_encoder(
    closed: float, stands: bool
) -> None:
    rng = np.random.default_rng(5)
    wander, swing = 50e-6 * np.sin(np.linspace(0.0, 9.0, 6000)), 1e-6 * rng.normal(size=6000)
    left = swing * (1.0 - closed)
    sides = {
        'encoder.y': Sides(swing**2, left**2, 'm', 1e-7, 1e-12),
        'tracker.y': Sides((wander + swing) ** 2, (wander + left) ** 2, 'm', 2e-6, 2.5e-9),
    }
    assert shrink_of('structural_resonance.y', sides, seed=0).matters is stands


@pytest.mark.parametrize(('arm', 'none'), [((0.08, 0.014), False), ((-0.98, 1.7), True)])
def test_a_yaw_whose_arm_may_be_of_any_length_is_none(
    arm: tuple[float, float], none: bool
) -> None:
    values = {'linear': (4e-5, 1e-6), 'quadratic': (0.0, 1e-6), 'arm': arm}
    assert untold('angular_error.x', values) is none


@pytest.mark.parametrize(
    ('stated', 'left', 'gain', 'worse', 'told'),
    [
        ({'coulomb_friction.x': {}}, 0.8, 20.0, (), True),
        ({'coulomb_friction.y': {}}, 0.8, 20.0, (), False),
        ({'coulomb_friction.x': {}}, 1.3, 20.0, (), False),
        ({'coulomb_friction.x': {}}, 0.8, 0.5, (), False),
        ({'coulomb_friction.x': {}}, 0.8, 20.0, ('tracker.x',), False),
    ],
    ids=['held', 'another axis', 'more than noise left', 'less than noise', 'a channel is worse'],
)
def test_an_axis_that_a_friction_holds_is_judged_by_a_balance_that_leaves_noise(
    stated: dict[str, dict[str, float]],
    left: float,
    gain: float,
    worse: tuple[str, ...],
    told: bool,
) -> None:
    name = 'inertia_mismatch.x'
    fit = SimpleNamespace(mean_square=lambda problem: left)
    evidence = {name: SimpleNamespace(share=1.0, gain=gain)}
    part = SimpleNamespace(
        name='servo.x',
        problem=None,
        selector=SimpleNamespace(noise=1.0),
        selection=SimpleNamespace(fit=fit, evidence=evidence),
    )
    run = SimpleNamespace(
        twin=SimpleNamespace(effects=stated), parameters={name: {}}, unrepeated_axes=set()
    )
    shrink = Shrink('m', 3.7e-6, 3.1e-6, (-0.02, 0.34), 1.4e-6, 0.1, worse)
    assert not shrink.matters
    assert _told_by_balance(name, part, shrink, run) == told
