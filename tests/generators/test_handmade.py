from __future__ import annotations

import numpy as np
import pytest

from benchmarks.generators import handmade
from benchmarks.generators.handmade import friction, kernel
from benchmarks.generators.handmade.settings import nominal
from benchmarks.generators.record import Planted, Wish

from .stages import assert_controlled, rest, stage, waves


def run(settings: dict, planted_axis: str = 'x', reference=None):
    planted = [Planted('test', planted_axis, settings=settings)]
    return handmade.simulate(stage(), reference or waves(), planted, 3)


def test_the_nominal_motion_obeys_newton():
    record = handmade.simulate(stage(), waves(), [], 3)
    # Impulse: what the motor gives between two ticks is the change of m·v + c·p.
    speed = np.gradient(record.motor[:, 0], 0.001)
    momentum = 10.0 * speed + 20.0 * record.motor[:, 0]
    given = np.cumsum(record.force[:, 0]) * 0.001
    off = momentum[1:-1] - 0.5 * (given[:-2] + np.append(0.0, given[:-3]))
    assert np.ptp(off) < 0.01 * np.ptp(momentum)


def test_the_controller_is_that_of_the_interfaces():
    assert_controlled(handmade.simulate(stage(), waves(), [], 3), 200)


def test_friction_loop_has_its_level_and_loses_its_work():
    axis = nominal(stage().axes[0])._replace(coulomb=np.array([5.0, 5.0]), presliding=4e-6)
    elements, work = np.zeros(4), 0.0
    path = 1e-3 * np.sin(np.linspace(0.0, 2.0 * np.pi, 200001))
    forces = []
    for step in np.diff(path)[::1]:
        forces.append(friction.friction(axis, elements, step / 1e-4, step, 1e-4, 1.0))
        work += forces[-1] * step
    assert max(forces) == pytest.approx(5.0, rel=1e-6)
    # A loop of 4 mm of sliding, less what the springs of the elements give back.
    assert work == pytest.approx(5.0 * 4e-3, rel=5e-3)


def test_static_friction_falls_to_coulomb_with_speed():
    axis = nominal(stage().axes[0])._replace(
        coulomb=np.array([5.0, 5.0]), static=15.0, stribeck_speed=0.005, presliding=4e-6
    )
    elements = np.zeros(4)
    slow = [friction.friction(axis, elements, 1e-5, 1e-8, 1e-3, 1.0) for _ in range(5000)]
    fast = [friction.friction(axis, elements, 0.1, 1e-5, 1e-4, 1.0) for _ in range(5000)]
    assert slow[-1] == pytest.approx(15.0, rel=0.01)
    assert fast[-1] == pytest.approx(5.0, rel=0.01)


def test_a_load_on_a_spring_rings_at_the_stated_pole():
    rng = np.random.default_rng(4)
    wish = Wish(stage(), waves(), 0, 1.0)
    (planted,) = handmade.draw(rng, 'structural_resonance', wish)
    # No controller: a push of one tick, and the two free bodies ring against each other.
    axis = nominal(stage().axes[0])._replace(
        velocity_gain=0.0, integral_gain=0.0, viscous=0.0, offset=1.0, **planted.settings['x']
    )
    ticks = 0.001 * np.arange(4000)
    nothing = np.zeros((4000, 2))
    _, log = kernel.run((axis, axis), ticks, nothing, nothing, nothing, 0.001)
    stretch = log[:, 0, 0] - log[:, 0, 2]
    spectrum = np.abs(np.fft.rfft((stretch - stretch[-500:].mean()) * np.hanning(4000), 2**17))
    found = np.fft.rfftfreq(2**17, 0.001)[np.argmax(spectrum)]
    assert found == pytest.approx(planted.parameters['frequency'], rel=0.01)


@pytest.mark.parametrize('effect', ['backlash', 'drive_play'])
def test_the_play_has_its_width(effect):
    wish = Wish(stage(), waves(), 0, 1.0)
    (planted,) = handmade.draw(np.random.default_rng(8), effect, wish)
    width = planted.parameters['width']
    if effect == 'backlash':
        record = handmade.simulate(stage(), waves(), [planted], 3)
        motor = np.interp(record.tracker_stamps, record.stamps, record.motor[:, 0])
        late = (motor - record.tracker[:, 0])[np.abs(np.gradient(motor)) > 2e-4]
        assert np.percentile(late, 97) - np.percentile(late, 3) == pytest.approx(width, rel=0.1)
    else:
        axis = nominal(stage().axes[0])._replace(**planted.settings['x'])
        pushed = [kernel.contact(axis, gap, 0.0) for gap in (0.4 * width, 0.6 * width)]
        assert pushed[0] < 0.02 * pushed[1]
        assert pushed[1] == pytest.approx(axis.play_stiffness * 0.1 * width, rel=0.01)


def test_a_static_force_is_carried_by_the_integrator():
    record = run({'x': {'offset': 4.0}}, reference=rest(3.0))
    assert record.force[-500:, 0].mean() == pytest.approx(-4.0, rel=1e-3)
    assert np.abs(record.motor[-1, 0]) < 2e-7


@pytest.mark.parametrize('effect', handmade.AXIS_EFFECTS + handmade.GLOBAL_EFFECTS)
def test_every_effect_changes_the_record(effect):
    wish = Wish(stage(), waves(2.0), 0, 1.0)
    planted = handmade.draw(np.random.default_rng(1), effect, wish)
    bare = handmade.simulate(stage(), waves(2.0), [], 3)
    record = handmade.simulate(stage(), waves(2.0), planted, 3)
    changes = [
        np.abs(getattr(record, key) - getattr(bare, key)).max()
        for key in ('encoder', 'tracker', 'effort', 'tracker_stamps')
    ]
    assert max(changes) > 1e-7
