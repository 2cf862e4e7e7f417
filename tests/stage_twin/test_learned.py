"""A law in a twin file does what the effect does that it describes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stage_core.twin_file import TwinFile
from stage_twin.effects import law_terms as lt
from stage_twin.effects import learned_force
from stage_twin.kinematics import carry
from stage_twin.simulate import simulate

PERIOD = 1e-3
TIMES = np.arange(3000) * PERIOD
PATH = np.stack([0.02 * (1.0 - np.cos(3.0 * TIMES)), 0.01 * np.sin(5.0 * TIMES)], axis=1)


def term(size: float, first: str, shape: int, scale: float, bend: float = 0.0, **more: float):
    """A law of one term."""
    plain = {'second0': 0.0, 'memory0': 0.0, 'reach0': 1e-6}
    number = float(lt.VARIABLES[first][0])
    own = {'size0': size, 'first0': number, 'shape0': shape, 'scale0': scale, 'bend0': bend}
    return {**plain, **own, **more}


#: Friction that rises by 6 N below 20 mm/s and holds the axis where it stands.
STRIBECK = term(-8.0, 's', lt.LINEAR, 1.0, reach0=1e-7) | {
    **{'size1': -6.0, 'first1': 3.0, 'shape1': lt.LINEAR, 'scale1': 1.0, 'reach1': 1e-7},
    **{'second1': 2.0, 'form1': lt.BUMP, 'length1': 0.02, 'turn1': 0.0, 'memory1': 0.0},
}


def encoder(effects):
    twin = TwinFile.nominal_servo().with_effects(effects)
    fine = {name: replace(axis, encoder_resolution=1e-9) for name, axis in twin.axes.items()}
    twin = replace(twin, axes=fine)
    return simulate(twin, PATH, np.gradient(PATH, PERIOD, axis=0), noise=False).encoder[:, 0]


@pytest.mark.parametrize(
    ('law', 'effect'),
    [
        (
            term(-8.0, '1', lt.PLAIN, 1.0, second0=3.0, form0=lt.LINEAR, length0=1.0, reach0=8e-6),
            {'coulomb_friction.x': {'coulomb': 8.0, 'presliding': 8e-6}},
        ),
        (
            STRIBECK,
            {
                'stribeck_friction.x': {
                    'coulomb': 8.0,
                    'breakaway': 6.0,
                    'stribeck_velocity': 0.02,
                    'presliding': 1e-7,
                }
            },
        ),
        (term(-10.0, 'v', lt.LINEAR, 0.1), {'viscous_friction.x': {'viscous': 100.0}}),
        (
            term(5.0, 'p', lt.SINE, 0.01, 0.3),
            {'force_ripple.x': {'amplitude': 5.0, 'phase': 0.3}},
        ),
        ({**term(0.0, 'p', 1, 1.0), 'mass': 1.8}, {'inertia_mismatch.x': {'ratio': 0.1}}),
        (
            term(-1.0, 'F', lt.LINEAR, 1.0, memory0=-2e-3),
            {'current_loop_lag.x': {'time_constant': 2e-3}},
        ),
    ],
)  # fmt: skip
def test_a_learned_force_is_the_effect_that_it_describes(law, effect):
    without, named, learned = encoder({}), encoder(effect), encoder({'learned_force.x': law})
    moved = np.abs(named - without).max()
    assert moved > 1e-7
    # A law is explicit but for its friction: its memory stands at the end of a substep.
    assert np.abs(named - learned).max() < 0.08 * moved


@pytest.mark.parametrize('size', [-3.0, 3.0])
def test_a_direction_that_drives_the_axis_is_no_friction(size):
    given = learned_force.EFFECT.defaults() | {f'size{k}': 0.0 for k in range(lt.TERMS)}
    law = np.array(list((given | term(size, 's', lt.LINEAR, 1.0, reach0=2e-6)).values()))
    state = np.zeros(len(lt.STATES))
    pushed = learned_force.force(0.0, 0.1, 0.0, 1e-3, 0.0, 0.0, 0.0, state, law)
    assert pushed == pytest.approx(max(size, 0.0))
    assert learned_force.sliding(0.0, 0.1, law) == max(-size, 0.0)
    assert learned_force.stiffness(law) == pytest.approx(max(-size, 0.0) / 2e-6)


def test_a_map_by_the_direction_is_as_stiff_as_its_newtons():
    law = np.zeros(len(learned_force.EFFECT.parameters))
    term = law[1 : 1 + lt.KNOT : lt.TERMS]
    term[[lt.SIZE, lt.FIRST, lt.SHAPE]] = 1.0, 1.0, lt.CURVE
    term[[lt.SECOND, lt.FORM, lt.REACH]] = lt.DIRECTION, lt.LINEAR, 2e-6
    law[1 + lt.KNOT :] = -10.0
    assert learned_force.stiffness(law) == pytest.approx(5e6)


def table(effects):
    warm = 20.0 + np.stack([TIMES, 0.0 * TIMES], axis=1)
    twin = TwinFile.nominal_servo().with_effects(effects)
    return carry(twin, PATH, warm)[:, 0]


@pytest.mark.parametrize(
    ('law', 'error'),
    [
        (term(4e-6, 'p', lt.SINE, 0.01, 0.5), 4e-6 * np.sin(200.0 * np.pi * PATH[:, 0] + 0.5)),
        (term(4e-6, 'q', lt.EVEN, 0.01, 2.5), 4e-6 * np.abs(PATH[:, 1] / 0.01) ** 2.5),
        (term(4e-6, 't', lt.LINEAR, 2.0), 2e-6 * TIMES),
        (
            term(4e-6, 'T', lt.LINEAR, 1.0, second0=1.0, form0=lt.LINEAR, length0=0.01),
            4e-6 * TIMES * PATH[:, 0] / 0.01,
        ),
        (
            term(4e-6, 'q', lt.LINEAR, 0.01, second0=1.0, form0=lt.SINE, length0=0.02, turn0=0.0),
            4e-6 * PATH[:, 1] / 0.01 * np.sin(100.0 * np.pi * PATH[:, 0]),
        ),
        (
            term(1e-6, 'p', lt.CURVE, 0.0, 0.04, **{f'knot{k}': float(k) for k in range(13)}),
            12e-6 * PATH[:, 0] / 0.04,
        ),
    ],
)  # fmt: skip
def test_a_learned_error_moves_the_table_by_its_equation(law, error):
    moved = table({'learned_error.x': law}) - table({})
    np.testing.assert_allclose(moved, error, atol=3e-9)


def test_a_direction_of_an_error_is_a_side_of_a_play():
    law = term(-5e-6, 's', lt.LINEAR, 1.0, reach0=10e-6)
    play = table({'backlash.x': {'width': 10e-6}})
    np.testing.assert_allclose(table({'learned_error.x': law}), play, atol=1e-12)


def test_an_excess_and_a_bump_are_what_they_are_called():
    assert lt.factor(-3.0, lt.EXCESS, 2.0, 4.0) == -0.25
    assert lt.factor(1.0, lt.EXCESS, 2.0, 4.0) == 0.0
    assert lt.factor(0.5, lt.BUMP, 0.1, 0.5) == 1.0
