from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from benchmarks.generators.record import Planted, Record, Wish

from .stages import assert_controlled, rest, stage, waves

pytest.importorskip('mujoco', reason='the MuJoCo generator is not installed')

from benchmarks.generators import mujoco_stage
from benchmarks.generators.mujoco_stage.loop import Rig
from benchmarks.generators.mujoco_stage.plan import planned


def drawn(effect: str, seed: int = 8) -> list[Planted]:
    wish = Wish(stage(), waves(2.0), 0, 1.0)
    return mujoco_stage.draw(np.random.default_rng(seed), effect, wish)


@cache
def unplanted() -> Record:
    return mujoco_stage.simulate(stage(), waves(0.6), [], 3)


def test_a_seed_is_a_session():
    again = mujoco_stage.simulate(stage(), waves(0.6), [], 3)
    np.testing.assert_array_equal(again.encoder, unplanted().encoder)
    np.testing.assert_array_equal(again.tracker, unplanted().tracker)


def rig(planted: list[Planted]) -> Rig:
    return Rig(planned(stage(), planted), 0.001, np.zeros(2))


def test_a_constant_force_on_the_nominal_axis_gives_the_exponential_speed():
    free = rig([])
    for k in range(1000):
        free.advance((30.0, 0.0), free.steps, 0.001 * k)
    # m v' = F − c v.
    assert free.data.qvel[0] == pytest.approx(30.0 / 20.0 * (1.0 - np.exp(-2.0)), rel=1e-3)
    assert free.data.qvel[1] == 0.0


def test_the_controller_is_that_of_the_interfaces():
    assert_controlled(mujoco_stage.simulate(stage(), waves(0.5), [], 3), 300)


def test_friction_loss_holds_below_its_level_and_slides_above():
    (planted,) = drawn('coulomb_friction')
    level = planted.parameters['coulomb']
    for share, slides in ((0.9, False), (1.3, True)):
        loop = rig([planted])
        for k in range(500):
            loop.advance((share * level, 0.0), loop.steps, 0.001 * k)
        moved = float(loop.data.qpos[loop.own[0]])
        assert (moved > 1e-3) == slides
        if slides:
            speed = 0.3 * level / 20.0 * (1.0 - np.exp(-2.0 * 0.5))
            assert float(loop.data.qvel[loop.own[0]]) == pytest.approx(speed, rel=0.03)


def test_the_play_has_its_width():
    (planted,) = drawn('backlash')
    record = mujoco_stage.simulate(stage(), waves(), [planted], 3)
    motor = np.interp(record.tracker_stamps, record.stamps, record.motor[:, 0])
    late = (motor - record.tracker[:, 0])[np.abs(np.gradient(motor)) > 2e-4]
    width = np.percentile(late, 97) - np.percentile(late, 3)
    assert width == pytest.approx(planted.parameters['width'], rel=0.03)


def test_a_load_on_a_spring_rings_at_the_stated_pole():
    (planted,) = drawn('structural_resonance', 4)
    loop = rig([planted])
    stretch = []
    for k in range(4000):
        loop.advance((10.0 if k < 3 else 0.0, 0.0), loop.steps, 0.001 * k)
        stretch.append(float(loop.data.qpos[loop.bodies[0][1]]))
    frequencies = np.fft.rfftfreq(2**17, 0.001)
    spectrum = np.abs(np.fft.rfft(stretch, 2**17)) * (frequencies > 10.0)
    found = frequencies[np.argmax(spectrum)]
    assert found == pytest.approx(planted.parameters['frequency'], rel=0.01)


def test_a_leaning_slide_couples_the_axes_by_the_stated_mass():
    planted = drawn('axis_crosstalk')
    loop = rig(planted)
    loop.advance((0.0, 30.0), loop.steps, 0.0)
    coupling = planted[0].parameters['mass']
    speeds = np.linalg.solve([[10.0, coupling], [coupling, 10.0]], [0.0, 0.03])
    np.testing.assert_allclose(loop.data.qvel[loop.own], speeds, rtol=2e-3, atol=1e-7)


def test_a_leaning_stage_is_carried_by_the_integrator():
    (planted,) = drawn('force_offset')
    record = mujoco_stage.simulate(stage(), rest(3.0), [planted], 3)
    offset = planted.parameters['offset']
    assert record.force[-500:, 0].mean() == pytest.approx(-offset, rel=2e-3)


@pytest.mark.parametrize('effect', mujoco_stage.AXIS_EFFECTS + mujoco_stage.GLOBAL_EFFECTS)
def test_every_effect_changes_the_record(effect):
    bare = unplanted()
    record = mujoco_stage.simulate(stage(), waves(0.6), drawn(effect, 1), 3)
    changes = [
        np.abs(getattr(record, key) - getattr(bare, key)).max()
        for key in ('encoder', 'tracker', 'effort', 'tracker_stamps', 'stamps')
    ]
    assert max(changes) > 1e-7
