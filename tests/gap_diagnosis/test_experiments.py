"""The experiment: motions keep the limits, the best one decides, the stage can run it."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from contour_ctrl.contour_parameters import PARAMETERS, make_timed
from gap_diagnosis.experiment import library, motions
from gap_diagnosis.experiment.design import Experiment, design
from gap_diagnosis.experiment.library import Library, left_open
from gap_diagnosis.experiment.motions import Limits
from gap_diagnosis.experiment.prediction import Noise, Predictor
from gap_diagnosis.experiment.questions import Pair
from gap_diagnosis.experiment.scene import Scene
from gap_diagnosis.experiment.separation import Predicted, decided, margin, squashed
from gap_diagnosis.report import experiment as file
from gap_diagnosis.result import Diagnosis
from stage_core.errors import StageError
from stage_core.twin_file import TwinFile
from stage_twin.effects import effect_of

PERIOD = 0.001
AXES = ('x', 'y')
LIMITS = Limits(
    np.array([-0.03, -0.02]), np.array([0.03, 0.02]), np.array([600.0, 600.0]), duration=21.0
)
NOISE = Noise(
    (math.inf,), np.full((1, 2), 0.01), np.full((1, 2), 0.2), 1e-3, np.full(2, 0.1), 1e-6
)
PREDICTOR = Predictor(TwinFile.nominal_servo(), NOISE, np.zeros(2))
#: Of the library, that a session is asked about.
NAMES = ('scale_error.x', 'torque_sag.x', 'force_offset.x', 'coulomb_friction.x')
OFFSET = {'force_offset.x': {'offset': (-10.0, 0.05)}}
FRICTION = {'coulomb_friction.x': {'coulomb': (10.0, 0.05), 'presliding': (2e-6, 1e-6)}}


def one_way() -> np.ndarray:
    """A session that never turns back."""
    s = np.clip(np.linspace(-0.1, 1.1, 4800), 0.0, 1.0)
    out = np.zeros((4800, 2))
    out[:, 0] = -0.02 + 0.04 * s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
    return out


@pytest.fixture(scope='module')
def experiment() -> Experiment:
    """What separates friction from an offset after a session in one direction."""
    pair = Pair(('force_offset.x', 'coulomb_friction.x'), OFFSET, FRICTION, {})
    found = design([pair], PREDICTOR, LIMITS, [one_way()])
    assert found is not None
    return found


@pytest.mark.parametrize('kind', motions.KINDS)
def test_every_motion_keeps_the_limits_from_rest_to_rest(kind: str) -> None:
    generator = np.random.default_rng(1)
    kept = 0
    for _ in range(20):
        position = motions.sample(motions.draw(kind, generator, 2), LIMITS, 6.0, PERIOD)
        assert position.shape == (6000, 2)
        assert np.abs(position[-1] - position[0]).max() < 1e-9
        assert np.abs(np.diff(position, axis=0)[[0, -1]]).max() < 1e-8
        kept += motions.excess(position, LIMITS, PERIOD) <= 1.02
    # What is beyond a limit is passed over by the design.
    assert kept >= 15


def test_parameters_take_back_a_difference_that_they_can_make() -> None:
    common = np.zeros((1, 50))
    shape = np.sin(np.arange(50.0))[None]
    sure = Predicted(2.0 * shape, np.zeros((0, 1, 50)))
    unsure = Predicted(shape, np.stack([3.0 * shape, -shape]))
    other = Predicted(np.roll(shape, 3, axis=1), np.zeros((0, 1, 50)))
    assert margin(sure, unsure, common) < 0.05
    assert margin(sure, other, common) > 1.0
    assert decided(sure, other, common) == 1.0
    assert decided(sure, sure, common) == 0.0


def test_friction_and_offset_are_told_apart_by_a_motion_that_turns(
    experiment: Experiment,
) -> None:
    assert experiment.separates == ['force_offset.x', 'coulomb_friction.x']
    assert experiment.before == 0.0
    assert experiment.expected == 1.0
    assert experiment.duration <= 1.2 * LIMITS.duration
    assert motions.excess(experiment.position, LIMITS, PERIOD) <= 1.02
    rate = np.diff(experiment.position[:, 0])
    assert rate.max() > 1e-7 and rate.min() < -1e-7


def small() -> np.ndarray:
    """A session of ±1 mm in which both axes move alike."""
    t = np.arange(4000) * PERIOD
    wave = 1e-3 * np.sin(2.0 * np.pi * 0.75 * t) * np.clip(np.minimum(t, t[-1] - t), 0.0, 1.0)
    return np.column_stack([wave, wave])


def bold() -> np.ndarray:
    """Strokes of the whole travel."""
    return motions.sample(motions.boldest('strokes', 2), LIMITS, 6.0, PERIOD)


def asked(
    positions: list[np.ndarray],
    verdict: list[str],
    below_noise: tuple[str, ...] = (),
    effects: dict[str, dict[str, float]] | None = None,
    names: tuple[str, ...] = NAMES,
) -> list[str]:
    """What is left open after sessions, of a few effects."""
    causes = [
        SimpleNamespace(effect=n, status='below_noise' if n in below_noise else 'rejected')
        for n in names
    ]
    record = SimpleNamespace(axes=AXES, moving=(True, True))
    found = SimpleNamespace(
        effects=effects or {},
        accepted=[*(effects or {})],
        verdict=verdict,
        causes=causes,
        records=[record],
    )
    scene = Scene(PREDICTOR, LIMITS)
    shown = [scene.shower(p) for p in positions]
    return left_open(cast(Diagnosis, found), shown, scene.shower(bold())).names


@pytest.fixture
def turning(monkeypatch: pytest.MonkeyPatch) -> None:
    """All axes turned back."""
    monkeypatch.setattr(library, 'turns', lambda records: dict.fromkeys(AXES, 9))


def test_a_small_session_is_asked_what_it_does_not_show(turning: None) -> None:
    assert asked([small()], []) == ['scale_error.x', 'torque_sag.x']
    # What remains unknown may be whatever was refused, but nothing that would have shown.
    refused = asked([small()], ['unknown'], ('force_offset.x',))
    assert refused == ['scale_error.x', 'torque_sag.x', 'coulomb_friction.x']


def test_a_session_that_shows_the_library_is_asked_nothing(turning: None) -> None:
    assert asked([bold()], []) == []
    # Nor is one that had little motion, once the stage moved again.
    assert asked([small(), bold()], []) == []


def test_what_a_session_shows_as_well_as_what_was_named_is_asked(turning: None) -> None:
    named = {'force_offset.x': {'offset': -10.0}}
    names = ('coulomb_friction.x',)
    found = asked([one_way()], ['force_offset.x'], effects=named, names=names)
    assert found == ['force_offset.x', 'coulomb_friction.x']


def in_session(*names: str) -> Library:
    """A library of a few effects with what they do in the small session."""
    some = Library({n: ({n: effect_of(n).defaults()}, {}) for n in names})
    made = some.made(Scene(PREDICTOR, LIMITS).shower(small()))
    return replace(some, products=made @ made.transpose(0, 2, 1), values=made.shape[-1])


def test_what_a_session_hides_is_shown_by_a_bold_motion() -> None:
    hidden = in_session('scale_error.x', 'scale_error.y')
    assert np.all(hidden.margins()[:, -1] < 1.0)
    found = design([], PREDICTOR, LIMITS, [small()], library=hidden)
    assert found is not None
    assert (found.before, found.expected) == (0.0, 1.0)
    assert np.ptp(found.position, axis=0).min() > 0.02


def test_a_session_that_shows_nothing_weakens_what_a_motion_shows() -> None:
    hidden = in_session('scale_error.x')
    alone = replace(hidden, values=0)
    products = np.full((4, 1, 1), 100.0)
    assert hidden.margins(products, 200)[0, -1] < 0.6 * alone.margins(products, 200)[0, -1]


def test_the_slope_goes_on_where_nothing_decides() -> None:
    shares = squashed(np.array([1e-3, 1e-2, 1.0, 9.0, np.inf]))
    np.testing.assert_allclose(shares, [1e-3, 1e-2, 0.5, 0.9, 1.0], rtol=0.02)


def test_no_effect_is_asked_to_stand_out_from_one_that_holds_it() -> None:
    margins = in_session('coulomb_friction.x', 'asymmetric_friction.x').margins()
    assert np.isinf(margins[0, 1]) and np.isfinite(margins[1, 0])


def test_a_motion_that_needs_too_much_force_is_none() -> None:
    pair = Pair(('force_offset.x', 'coulomb_friction.x'), OFFSET, FRICTION, {})
    weak = replace(LIMITS, force=np.array([5.0, 5.0]))
    assert design([pair], PREDICTOR, weak, [one_way()]) is None


def test_the_contour_controller_takes_the_motion(experiment: Experiment, tmp_path: Path) -> None:
    path = file.write(experiment, tmp_path)
    values = {p.name: p.default for p in PARAMETERS}
    values |= {'contour': 'timed', 'curve_file': str(path)}
    reference = make_timed(values.__getitem__)
    count = min(len(reference), len(experiment.position))
    assert count > 0.99 * len(experiment.position)
    apart = np.abs(reference.position[:count] - experiment.position[:count]).max()
    assert apart < 3e-7
    slow = {**values, 'x.max_velocity': 1e-4, 'y.max_velocity': 1e-4}
    with pytest.raises(StageError, match='exceeds the speed limit'):
        make_timed(slow.__getitem__)
    path.write_text('t,x\n0,1\n')
    with pytest.raises(StageError, match='no timed motion'):
        make_timed(values.__getitem__)
