"""The library as a whole: complete, checked, and every parameter reaches the simulation."""

import importlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from stage_core.errors import StageError
from stage_core.quantities import LINKS
from stage_core.twin_file import TwinFile
from stage_twin import effects
from stage_twin.effects import EFFECTS
from stage_twin.packing import pack
from stage_twin.simulate import simulate

PERIOD = 1e-3
TIMES = np.arange(1500) * PERIOD
CHANNELS = ('encoder', 'table', 'tracker_points', 'tracker_stamps', 'times', 'force')
PARAMETERS = [
    (effect.name, parameter.name) for effect in EFFECTS.values() for parameter in effect.parameters
]


def named(effect):
    return f'{effect}.x' if EFFECTS[effect].per_axis else effect


def switched_on(name):
    """Values at which every parameter of an effect does something."""
    values = EFFECTS[name].defaults()
    for parameter in EFFECTS[name].parameters:
        if parameter.neutral == parameter.when_on:
            step = 0.02 * (parameter.maximum - parameter.minimum)
            values[parameter.name] = parameter.when_on + min(step, parameter.maximum)
    # It only shapes what others switch on.
    return values | ({'growth': 0.1} if 'growth' in values else {})


def run(effects):
    twin = TwinFile.nominal_servo().with_effects(effects)
    step = 2e-3 * (TIMES > 0.8)
    x = 0.02 * (1.0 - np.cos(4.0 * TIMES)) + step
    y = 0.015 * np.sin(3.0 * TIMES) ** 2 + 0.01
    reference = np.stack([x, y], axis=1)
    return simulate(twin, reference, np.gradient(reference, PERIOD, axis=0), noise=False)


@pytest.fixture(scope='module')
def nominal():
    return run({})


def test_the_library_holds_every_file_of_its_folder():
    files = {path.stem for path in Path(effects.__file__).parent.glob('*.py')}
    assert files > EFFECTS.keys()
    for name in files - EFFECTS.keys() - {'__main__'}:
        module = importlib.import_module(f'stage_twin.effects.{name}')
        # An effect of another name than its file's would be found by nobody.
        assert not hasattr(module, 'EFFECT')
    links = [LINKS.index(effect.link) for effect in EFFECTS.values()]
    assert links == sorted(links)


@pytest.mark.parametrize('name', EFFECTS)
def test_definitions_are_physical(name):
    effect = EFFECTS[name]
    assert effect.parameters
    # A citation has a year or names a paper of the project's list.
    assert any(word in effect.model for word in ('(19', '(20', ':20', 'paper 1', 'Eq. 24'))
    for parameter in effect.parameters:
        assert parameter.minimum <= parameter.when_on <= parameter.maximum
        assert parameter.meaning
    assert any(not parameter.nuisance for parameter in effect.parameters)


@pytest.mark.parametrize('name', EFFECTS)
def test_every_effect_moves_its_link(name, nominal):
    result = run({named(name): switched_on(name)})
    encoder = np.abs(result.encoder - nominal.encoder).max()
    table = np.abs(result.table - nominal.table).max()
    points = np.abs(result.tracker_points - nominal.tracker_points).max()
    stamps = np.abs(result.tracker_stamps - nominal.tracker_stamps).max()
    stamps = max(stamps, np.abs(result.times - nominal.times).max())
    force = np.abs(result.force - nominal.force).max()
    link = EFFECTS[name].link
    if link == 'servo' or name.startswith('encoder'):
        assert encoder > 1e-6
    elif link == 'kinematic':
        assert encoder == 0.0
        assert table > 1e-7
    else:
        assert encoder == table == 0.0
        assert points > 1e-7 or stamps > 1e-6 or force > 1.0


@pytest.mark.parametrize(('effect', 'parameter'), PARAMETERS)
def test_every_parameter_moves_the_output(effect, parameter):
    definition = EFFECTS[effect].parameter(parameter)
    span = definition.maximum - definition.minimum
    value = switched_on(effect)[parameter]
    moved = value + 0.02 * span if value + 0.02 * span <= definition.maximum else value / 2.0
    values = switched_on(effect)
    first = run({named(effect): values})
    changes = []
    for other in (moved, definition.maximum):
        second = run({named(effect): {**values, parameter: other}})
        changes += [
            np.abs(getattr(first, channel) - getattr(second, channel)).max()
            for channel in CHANNELS
        ]
    assert max(changes) > 1e-10


#: Values in range that make a machine unstable: a loop with other gains, a spring that pushes.
UNSTABLE = {'controller_mismatch', 'position_force', 'learned_force', 'learned_error'}
#: Stronger, a spring with its centre beside the travel throws the stage away.
LEAST, MOST = {'hardening': 0.0}, {'hardening': 1e7}


@st.composite
def any_effects(draw):
    effects = {}
    for name in draw(
        st.lists(st.sampled_from(sorted(EFFECTS.keys() - UNSTABLE)), max_size=5, unique=True)
    ):
        effects[named(name)] = {
            parameter.name: draw(
                st.floats(
                    LEAST.get(parameter.name, parameter.minimum),
                    MOST.get(parameter.name, parameter.maximum),
                )
            )
            for parameter in EFFECTS[name].parameters
        }
    return effects


@settings(max_examples=60, deadline=None)
@given(any_effects())
# A stiff play with hardly any width.
@example({'drive_play.x': {'width': 1e-40, 'mass_ratio': 0.8, 'contact_frequency': 800.0}})
# Half of the mass on the drive's side of a play, and half of it behind a spring.
@example(
    {
        'structural_resonance.x': {'frequency': 1.0, 'mass_ratio': 0.5},
        'drive_play.x': {'width': 0.0005, 'mass_ratio': 0.5},
    }
)
# Friction that gives way at the smallest speed that there is.
@example({'coulomb_friction.x': {'coulomb': 20.0, 'presliding': 0.0, 'creep_velocity': 5e-324}})
def test_any_values_in_range_keep_the_stage_within_bounds(effects):
    slippery = [effects.get(n, {}) for n in ('viscous_friction.x', 'asymmetric_friction.x')]
    drives = any(value < 0.0 for values in slippery for value in values.values())
    try:
        result = run(effects)
    except StageError:
        # Friction that drives, and a play and a spring that leave the carriage next to no mass.
        assert drives or effects.keys() >= {'drive_play.x', 'structural_resonance.x'}
        return
    # The swing of a friction that drives grows until the twin refuses it.
    assert drives or np.abs(result.encoder).max() < 3.0 + pushed_away(effects)
    assert np.isfinite(result.table).all()
    assert np.isfinite(result.tracker_points).all()


def test_effects_that_throw_the_stage_away_are_refused():
    with pytest.raises(StageError, match='flies away: weaken its effects cable_force.x'):
        run({'cable_force.x': {'stiffness': 0.0, 'centre': 1.0, 'hardening': 1e9}})


def pushed_away(effects: dict[str, dict[str, float]]) -> float:
    """How far forces of `effects` push a drive whose own force is clipped, in m.

    These are a constant one, that of a long wave, and the pull of the other axis, which has at
    most 0.05 m/s and 0.3 m/s².
    """
    force = sum(
        abs(value)
        for effect in ('force_offset', 'force_ripple')
        for key, value in effects.get(f'{effect}.x', {}).items()
        if EFFECTS[effect].parameter(key).unit == 'N'
    )
    other = effects.get('axis_crosstalk.x', {})
    force += 0.05 * abs(other.get('viscous', 0.0)) + 0.3 * abs(other.get('mass', 0.0))
    return force / TwinFile.nominal_servo().axes['x'].mass * TIMES[-1] ** 2 / 2.0


def test_no_effect_is_bit_identical_to_effects_at_zero(nominal):
    effects = {
        'coulomb_friction.x': {'coulomb': 0.0},
        'backlash.x': {'width': 0.0},
        'force_ripple.y': {'amplitude': 0.0},
        'force_saturation.x': {'limit': 0.0},
        'structural_resonance.x': {'mass_ratio': 0.0},
    }
    result = run(effects)
    np.testing.assert_array_equal(result.encoder, nominal.encoder)
    np.testing.assert_array_equal(result.table, nominal.table)


@pytest.mark.parametrize(
    ('effects', 'words'),
    [
        ({'gremlins.x': {}}, 'gremlins.x is unknown'),
        ({'backlsh.x': {}}, 'did you mean backlash?'),
        ({'backlash.x': {'widht': 8e-6}}, 'no parameter widht: did you mean width?'),
        ({'backlash': {}}, 'belongs to an axis'),
        ({'nonorthogonality.x': {}}, 'without .x'),
        ({'backlash.z': {}}, 'no axis z'),
        ({'backlash.x': {'size': 1e-6}}, 'no parameter size'),
        ({'backlash.x': {'width': -1e-6}}, 'effects.backlash.x.width = -1e-06 is out of range'),
        ({'backlash.x': {'width': 1.0}}, 'give 0 to 0.001 m'),
        ({'backlash.x': {'width': float('nan')}}, 'out of range'),
        ({'coulomb_friction.y': {'presliding': 2e-3}}, 'give 0 to 0.001 m'),
        ({'viscous_friction.x': {'viscous': -41.0}}, 'axis x: viscous friction comes to -1'),
    ],
)
def test_a_wrong_effect_is_named(effects, words):
    with pytest.raises(StageError) as caught:
        pack(TwinFile.nominal_servo().with_effects(effects))
    assert words in str(caught.value)


def test_a_stepper_has_no_servo_link():
    twin = TwinFile.from_dict({'kind': 'stepper', 'axes': {'x': {}, 'y': {}}})
    with pytest.raises(StageError, match='stepper twin has none'):
        pack(twin.with_effects({'coulomb_friction.x': {}}))


@pytest.mark.parametrize(
    ('change', 'words'),
    [
        ({'reference': np.zeros((5, 3))}, 'give (n, 2)'),
        ({'reference': np.zeros(5)}, 'give (n, 2)'),
        ({'reference': np.full((5, 2), np.nan)}, 'not finite'),
        ({'rate': np.zeros((4, 2))}, 'give (5, 2)'),
        ({'kind': 'stepper'}, 'this one is stepper'),
    ],
)
def test_wrong_input_of_a_simulation_is_named(change, words):
    twin = TwinFile.nominal_servo()
    if 'kind' in change:
        twin = replace(twin, kind=change['kind'])
    reference = change.get('reference', np.zeros((5, 2)))
    with pytest.raises(StageError) as caught:
        simulate(twin, reference, change.get('rate', np.zeros((5, 2))))
    assert words in str(caught.value)


@pytest.mark.parametrize('name', EFFECTS)
def test_a_report_says_what_was_found(name):
    effect = EFFECTS[name]
    values = {p.name: 0.5 * (p.minimum + p.maximum) for p in effect.parameters}
    sentence = effect.says(values)
    assert sentence[0].islower() and not set('{}') & set(sentence)
    assert any(p.said(values[p.name]) in sentence for p in effect.parameters)
    rivals = {*effect.holds, *effect.excludes, *effect.merges}
    assert rivals <= EFFECTS.keys()
