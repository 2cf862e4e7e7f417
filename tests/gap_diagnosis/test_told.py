"""A lag is told from a delay although the recorded force answers to the encoder's noise."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.experiment.machine import draw, poor_motion, record
from benchmarks.experiment.machine import nominal as plane
from gap_diagnosis.closed_loop.axis_loop import AxisLoop
from gap_diagnosis.closed_loop.replay import AWAY
from gap_diagnosis.diagnose import diagnose, silent
from gap_diagnosis.evidence.acceptance import FAR_BESIDE
from gap_diagnosis.input.data import Record
from gap_diagnosis.memory import Memory
from gap_diagnosis.parameters import Effects, Parameters
from gap_diagnosis.passes import prepare, servo_part
from gap_diagnosis.residuals.servo import Servo
from gap_diagnosis.selection.servo_part import _to_bar, _worse
from gap_diagnosis.selection.told import MUCH_CLOSER, told_by_loop
from stage_core.arrays import Array
from stage_core.session import Session
from stage_core.twin_file import TwinFile
from stage_twin.simulate import simulate

from .conftest import nominal

DELAY, LAG = 'actuation_delay.x', 'current_loop_lag.x'


def record_of(effect: str, key: str, twin: TwinFile, beside: Effects | None = None) -> Record:
    """A sweep to 80 Hz in the middle of slow strokes, 16 s of one axis."""
    t = np.arange(16000) * 1e-3
    rise = np.clip(t - 6.0, 0.0, 4.0)
    sweep = 2e-4 * np.sin(2.0 * np.pi * (2.0 * rise + 9.75 * rise**2)) * (rise < 4.0)
    path = (0.02 * np.sin(2.0 * np.pi * 0.4 * t) + sweep)[:, None]
    rate = np.gradient(path, 1e-3, axis=0)
    machine = twin.with_effects({effect: {key: 2e-3}, **(beside or {})})
    run = simulate(machine, path, rate, seed=1)
    return Record(
        'sweep',
        ('x',),
        1e-3,
        t,
        path,
        rate,
        run.velocity_command,
        run.force,
        run.encoder,
        None,
        None,
        None,
        moving=(True,),
    )


@pytest.mark.parametrize(
    ('planted', 'key', 'rival', 'other'),
    [(LAG, 'time_constant', DELAY, 'delay'), (DELAY, 'delay', LAG, 'time_constant')],
)
def test_the_loop_tells_a_lag_from_a_delay(planted: str, key: str, rival: str, other: str) -> None:
    twin = nominal()
    coarse = replace(twin.servo('x'), encoder_resolution=8e-6)
    twin = replace(twin, axes={'x': coarse})
    loop = AxisLoop([record_of(planted, key, twin)], twin, 'x')

    def left(name: str, parameter: str) -> float:
        found = {name: {parameter: (2e-3, 1e-4)}}
        return float(np.mean(loop.window_gaps(found)))

    assert left(planted, key) < left(rival, other)
    refined = loop.refined({planted: {key: (2.1e-3, 1e-4)}})[planted][key]
    assert refined[0] == pytest.approx(2e-3, rel=0.01)


@pytest.mark.parametrize(
    ('planted', 'key', 'rival', 'other'),
    [(LAG, 'time_constant', DELAY, 'delay'), (DELAY, 'delay', LAG, 'time_constant')],
)
def test_a_loop_that_is_far_from_the_record_tells_which_comes_closer(
    planted: str, key: str, rival: str, other: str
) -> None:
    """Beside a force that nobody told, and from values that the balance estimated wrong."""
    twin = nominal()
    unknown: Effects = {'force_ripple.x': {'amplitude': 0.5, 'period': 3e-3, 'phase': 0.0}}
    loop = AxisLoop([record_of(planted, key, twin, unknown)], twin, 'x')
    right = loop.closest({planted: {key: (1.8e-3, 1e-5)}})
    wrong = loop.closest({rival: {other: (1.8e-3, 1e-5)}})
    assert FAR_BESIDE * loop.floor < right < MUCH_CLOSER * wrong


@pytest.mark.parametrize(('share', 'exchanged'), [(0.95, False), (0.5, True)])
def test_a_richer_alternative_has_to_follow_much_closer(
    planted: Callable[..., Session], share: float, exchanged: bool
) -> None:
    """A torque that sags within a second is a gain of the drive with parameters more."""
    gain, sag = 'drive_gain.x', 'torque_sag.x'

    class Loop(AxisLoop):
        """One whose gap is by a share less with the richer effect, for certain."""

        def window_gaps(self, found: Parameters) -> Array:
            return np.full(12, 2.0 * self.floor * (share if sag in found else 1.0))

    before = prepare([planted({gain: {'error': -0.11}})], [], nominal(), ())
    part = servo_part(before, 'x', before.direct, 0, [], Memory(), silent)
    assert part.selection.accepted == [gain]
    own = replace(part.selection.evidence[gain], alternatives=[sag])
    part = replace(part, selection=replace(part.selection, evidence={gain: own}))
    told = told_by_loop(part, Loop(before.records, before.twin, 'x', before.direct))
    assert told.accepted == [sag if exchanged else gain]


def test_of_effects_that_are_refuted_together_the_one_that_alone_fits_is_kept() -> None:
    twin = nominal()
    loop = AxisLoop([record_of(DELAY, 'delay', twin)], twin, 'x')
    found = {
        DELAY: {'delay': (2e-3, 1e-4)},
        'drive_gain.x': {'error': (-0.8, 1e-3)},
        'inertia_mismatch.x': {'ratio': (6.0, 1e-3)},
    }
    assert _worse(list(found), found, loop) == ['drive_gain.x', 'inertia_mismatch.x']
    wrong = {n: v for n, v in found.items() if n != DELAY}
    assert _worse(list(wrong), wrong, loop) == list(wrong)


def test_of_a_set_that_is_refuted_the_main_effect_is_judged_anew(
    planted: Callable[..., Session],
) -> None:
    friction, damping = 'coulomb_friction.x', 'viscous_friction.x'
    made = planted({friction: {'coulomb': 8.0}, damping: {'viscous': 30.0}})
    before = prepare([made], [], nominal(), ())
    selection = servo_part(before, 'x', before.direct, 0, [], Memory(), silent).selection
    assert set(selection.accepted) == {friction, damping}
    assert _to_bar(selection, list(selection.accepted)) == [damping]
    assert _to_bar(selection, [friction]) == [friction]
    alone = replace(selection, accepted=[friction])
    assert _to_bar(alone, [friction]) == [friction]


def test_an_alternative_beside_which_no_machine_has_the_others_is_none() -> None:
    """A force limit of 9 mN in the place of a lag came with a mass of nothing."""
    case = draw(177)
    found = diagnose([record(case, poor_motion(case), case.seed, 'first')], [], plane())
    assert 'force_saturation.x' not in found.verdict


def test_a_set_with_which_no_machine_runs_is_away_and_no_number_is_lost() -> None:
    twin = nominal()
    loop = AxisLoop([record_of(DELAY, 'delay', twin)], twin, 'x')
    gaps = loop.window_gaps({'viscous_friction.x': {'viscous': (-400.0, 1.0)}})
    np.testing.assert_allclose(gaps, AWAY)


@pytest.mark.filterwarnings('error')
def test_an_axis_that_never_slides_has_no_rows() -> None:
    twin = nominal()
    record = record_of(DELAY, 'delay', twin)
    still = replace(record, encoder=0.0 * record.encoder, reference=0.0 * record.reference)
    used, judged = Servo([still], twin, 'x').split()
    assert not used.any() and not judged.any()
