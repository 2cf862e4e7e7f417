"""One axis as a model file describes it, and the twin that says the same.

A model's controller commands `ctrl`; its joint gets `gain` times that (gear times gain of the
actuator). The twin knows forces of the command only, so that its equation of motion is that of the
joint divided by the gain: m/g · a + b/g · v + … = F.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

from stage_core.errors import StageError
from stage_core.quantities import split_effect
from stage_core.twin_file import TwinFile
from stage_twin.effects import link_of

Effects = Mapping[str, Mapping[str, float]]


def instruments(twin: TwinFile) -> TwinFile:
    """The twin without the effects of its plant: controller, encoder, table and tracker are left.

    A limit that the controller itself has is the controller's.
    """
    effects = {
        name: dict(values)
        for name, values in twin.effects.items()
        if link_of(name) != 'servo'
        or split_effect(name)[0] == 'controller_mismatch'
        or values.get('known', 0.0) > 0.5
    }
    return replace(twin, effects=effects)


@dataclass(frozen=True)
class Plant:
    """One axis at its joint.

    Attributes
    ----------
    mass [kg], viscous [N·s/m], coulomb [N] : all that moves with the joint, and its friction
    stiffness [N/m], centre [m] : spring to the position `centre`
    offset [N] : constant force, as of gravity along the joint
    gain : force at the joint per commanded force
    limit [N] : largest command that the actuator follows
    lag, delay [s] : first-order lag and dead time of the force
    """

    mass: float
    viscous: float = 0.0
    coulomb: float = 0.0
    stiffness: float = 0.0
    centre: float = 0.0
    offset: float = 0.0
    gain: float = 1.0
    limit: float = math.inf
    lag: float = 0.0
    delay: float = 0.0


def as_twin(plants: Mapping[str, Plant], controller: TwinFile) -> TwinFile:
    """The twin of a model.

    Controller, encoder, tracker and the effects of the other links are those of the file of the
    `controller`; its masses, friction and effects of the servo link give way to the model's. Axes
    that only one of them has are left out.

    Raises
    ------
    StageError
        If the file is no servo twin, or has none of these axes.
    """
    shared = [axis for axis in plants if axis in controller.axes]
    if not shared:
        raise StageError(f'the controller has no axis {" or ".join(plants)}, which the model has')
    axes, effects = {}, instruments(controller).effects
    for axis in shared:
        own, plant = controller.servo(axis), plants[axis]
        gain = plant.gain
        axes[axis] = replace(
            own,
            mass=plant.mass / gain,
            viscous=plant.viscous / gain,
            delay=own.delay + plant.delay,
        )
        effects |= {f'{n}.{axis}': v for n, v in _effects(plant, own.force_limit).items()}
    return replace(controller, axes=dict(axes), effects=effects)


def _effects(plant: Plant, force_limit: float) -> dict[str, dict[str, float]]:
    gain = plant.gain
    out: dict[str, dict[str, float]] = {}
    if plant.coulomb > 0.0:
        out['coulomb_friction'] = {'coulomb': plant.coulomb / gain, 'presliding': 0.0}
    if plant.stiffness > 0.0:
        out['cable_force'] = {'stiffness': plant.stiffness / gain, 'centre': plant.centre}
    if plant.offset != 0.0:
        out['force_offset'] = {'offset': plant.offset / gain}
    if plant.limit < force_limit:
        out['force_saturation'] = {'limit': plant.limit, 'known': 0.0}
    if plant.lag > 0.0:
        out['current_loop_lag'] = {'time_constant': plant.lag}
    return out


def corrected(plants: Mapping[str, Plant], effects: Effects) -> dict[str, Plant]:
    """The plants with what a diagnosis against :func:`as_twin` has accepted.

    `effects` are the accepted ones: one that the model has already comes with its whole new value.
    What a model file cannot say is left out, see :mod:`stage_twin.models.unsaid`; of a friction
    richer than one level its mean is taken.
    """
    out = {}
    for axis, plant in plants.items():
        own = {split_effect(n)[0]: v for n, v in effects.items() if split_effect(n)[1] == axis}
        out[axis] = _rubbed(_driven(_loaded(plant, own), own), own, plant.gain)
    return out


def _loaded(plant: Plant, own: Effects) -> Plant:
    """Mass, spring and constant force."""
    if 'inertia_mismatch' in own:
        plant = replace(plant, mass=plant.mass * (1.0 + own['inertia_mismatch']['ratio']))
    if 'cable_force' in own:
        spring = own['cable_force']
        plant = replace(
            plant,
            stiffness=spring['stiffness'] * plant.gain,
            centre=spring.get('centre', 0.0),
            # The spring with its centre has taken the constant force over.
            offset=0.0 if 'force_offset' not in own else plant.offset,
        )
    if 'force_offset' in own:
        plant = replace(plant, offset=own['force_offset']['offset'] * plant.gain)
    return plant


def _driven(plant: Plant, own: Effects) -> Plant:
    """Gain, limit, lag and delay of the drive."""
    if 'drive_gain' in own:
        plant = replace(plant, gain=plant.gain * (1.0 + own['drive_gain']['error']))
    saturation = own.get('force_saturation', {})
    if saturation and saturation.get('known', 0.0) < 0.5:
        plant = replace(plant, limit=saturation['limit'])
    if 'current_loop_lag' in own:
        plant = replace(plant, lag=own['current_loop_lag']['time_constant'])
    if 'actuation_delay' in own:
        plant = replace(plant, delay=plant.delay + own['actuation_delay']['delay'])
    return plant


def _rubbed(plant: Plant, own: Effects, gain: float) -> Plant:
    """Friction; `gain` is that of the forces in the effects."""
    if 'viscous_friction' in own:
        plant = replace(plant, viscous=plant.viscous + gain * own['viscous_friction']['viscous'])
    for name in ('coulomb_friction', 'stribeck_friction'):
        if name in own:
            plant = replace(plant, coulomb=gain * own[name]['coulomb'])
    if 'asymmetric_friction' in own:
        sides = own['asymmetric_friction']
        forwards, backwards = sides['coulomb_positive'], sides['coulomb_negative']
        added = 0.5 * (sides.get('viscous_positive', 0.0) + sides.get('viscous_negative', 0.0))
        plant = replace(
            plant,
            coulomb=0.5 * gain * (forwards + backwards),
            viscous=plant.viscous + gain * added,
            offset=0.5 * gain * (backwards - forwards),
        )
    return plant
