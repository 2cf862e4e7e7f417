"""MuJoCo models (MJCF): slide joints `x`, `y` with one actuator each, read and mended."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from stage_core.errors import StageError
from stage_twin.models.mjcf_axes import load, places
from stage_twin.models.plant import Plant
from stage_twin.models.xml_text import Element, XmlText

#: Relative change below which a value of the file stands.
SAME = 1e-9
#: Share of a mass that another joint may move with, before it is said.
COUPLED = 1e-6


class Mjcf:
    """A model of the stage.

    Attributes
    ----------
    plants : dict of str, Plant
    notes : list of str
        What of the model the twin does not have.

    Raises
    ------
    StageError
        See :func:`load` and :func:`places`; also where a joint stands in an included file.
    """

    form = 'MJCF'

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self.model = load(path)
        self.places = places(self.model, path)
        self.text = XmlText(path)
        self.notes: list[str] = []
        self._directions: dict[str, np.ndarray] = {}
        #: Pull of gravity [N] that mass taken off bodies takes with it.
        self._lifted: dict[str, float] = {}
        self.plants = {axis: self._plant(axis) for axis in self.places}
        self._note_rest()
        for axis in self.places:
            # What cannot be mended is refused before a diagnosis, not after it.
            self._joint(axis)
            self._actuator(axis)

    def _joint(self, axis: str) -> Element:
        def wanted(e: Element) -> bool:
            return e.tag == 'joint' and 'worldbody' in e.path and e.attributes.get('name') == axis

        return self._own(f'joint {axis}', wanted)

    def _actuator(self, axis: str) -> Element:
        def wanted(e: Element) -> bool:
            return e.path[-1:] == ('actuator',) and e.attributes.get('joint') == axis

        return self._own(f'the actuator of joint {axis}', wanted)

    def _own(self, what: str, wanted: Callable[[Element], bool]) -> Element:
        """The element that is wanted, in the file itself."""
        found = self.text.find(wanted)
        if found is None:
            raise StageError(
                f'{self.path}: {what} stands in an included file: give one file without include '
                '(mujoco.mj_saveLastXML writes one)'
            )
        return found

    def _plant(self, axis: str) -> Plant:
        import mujoco

        model, at = self.model, self.places[axis]
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        self._directions[axis] = data.xaxis[at.joint].copy()
        inertia = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, inertia)
        if np.any(np.abs(np.delete(inertia[at.dof], at.dof)) > COUPLED * inertia[at.dof, at.dof]):
            self.notes.append(f'joint {axis} shares inertia with another joint')
        gear, gain = model.actuator_gear[at.actuator, 0], model.actuator_gainprm[at.actuator, 0]
        constant = data.qfrc_gravcomp[at.dof] - data.qfrc_bias[at.dof] + gear * self._bias(axis)
        filtered = int(model.actuator_dyntype[at.actuator]) != int(mujoco.mjtDyn.mjDYN_NONE)
        delays = getattr(model, 'actuator_delay', np.zeros(model.nu))
        return Plant(
            mass=float(inertia[at.dof, at.dof]),
            viscous=float(model.dof_damping[at.dof]),
            coulomb=float(model.dof_frictionloss[at.dof]),
            stiffness=float(model.jnt_stiffness[at.joint]),
            centre=float(model.qpos_spring[at.position]),
            offset=0.0 if abs(constant) < 1e-12 else float(constant),
            gain=float(gear * gain),
            limit=self._limit(axis),
            lag=float(model.actuator_dynprm[at.actuator, 0]) if filtered else 0.0,
            delay=float(delays[at.actuator]),
        )

    def _bias(self, axis: str) -> float:
        """Constant force of the actuator before its gear [N]."""
        import mujoco

        k = self.places[axis].actuator
        affine = int(self.model.actuator_biastype[k]) == int(mujoco.mjtBias.mjBIAS_AFFINE)
        return float(self.model.actuator_biasprm[k, 0]) if affine else 0.0

    def _limit(self, axis: str) -> float:
        """Largest command that has its full effect [N]."""
        model, at = self.model, self.places[axis]
        gain = abs(float(model.actuator_gainprm[at.actuator, 0]))
        gear = abs(float(model.actuator_gear[at.actuator, 0]))
        limits = [math.inf]
        for limited, bounds, scale, what in (
            (model.actuator_ctrllimited[at.actuator], model.actuator_ctrlrange[at.actuator], 1.0,
             'ctrlrange'),
            (model.actuator_forcelimited[at.actuator], model.actuator_forcerange[at.actuator],
             gain, 'forcerange'),
            (model.jnt_actfrclimited[at.joint], model.jnt_actfrcrange[at.joint],
             gain * gear, 'actuatorfrcrange'),
        ):  # fmt: skip
            if not limited:
                continue
            if abs(bounds[0] + bounds[1]) > SAME * bounds[1]:
                raise StageError(
                    f'{self.path}: {what} of joint {axis} is not symmetric: the twin has one '
                    'limit for both directions'
                )
            limits.append(float(bounds[1]) / scale)
        return min(limits)

    def _note_rest(self) -> None:
        model, dofs = self.model, [at.dof for at in self.places.values()]
        if model.nv > len(dofs):
            self.notes.append('joints beside x and y stand still in the twin')
        for name in ('dof_dampingpoly', 'jnt_stiffnesspoly', 'actuator_damping'):
            if np.any(getattr(model, name, 0.0)):
                self.notes.append(f'{name} is not read')

    def write(self, wanted: Mapping[str, Plant]) -> str:
        """The model's text with other plants; :attr:`text` then holds what was changed."""
        self.text, self._lifted = XmlText(self.path), dict.fromkeys(self.places, 0.0)
        for axis, plant in wanted.items():
            self._write_joint(axis, self.plants[axis], plant)
            self._write_mass(axis, plant.mass - self.plants[axis].mass)
        for axis, plant in wanted.items():
            self._write_actuator(axis, self.plants[axis], plant)
        return self.text.text

    def _write_joint(self, axis: str, old: Plant, new: Plant) -> None:
        where = f'joint {axis}'
        for attribute, before, after in (
            ('damping', old.viscous, new.viscous),
            ('frictionloss', old.coulomb, new.coulomb),
            ('stiffness', old.stiffness, new.stiffness),
            ('springref', old.centre, new.centre if new.stiffness else old.centre),
        ):
            if differs(before, after):
                self.text.set(self._joint(axis), where, attribute, written(after))

    def _write_mass(self, axis: str, more: float) -> None:
        """More mass as armature, which moves with this joint alone; less of it off the body."""
        at = self.places[axis]
        armature = float(self.model.dof_armature[at.dof])
        if not differs(self.plants[axis].mass, self.plants[axis].mass + more):
            return
        rest = max(armature + more, 0.0)
        if differs(armature, rest):
            self.text.set(self._joint(axis), f'joint {axis}', 'armature', written(rest))
        less = rest - armature - more
        if less > 0.0:
            self._lighten(axis, less)

    def _lighten(self, axis: str, less: float) -> None:
        """Take mass off the joint's body; what carries that body gets it as armature."""
        model, at = self.model, self.places[axis]
        body = int(model.jnt_bodyid[at.joint])
        own = float(model.body_mass[body])
        if less >= own:
            raise StageError(
                f'{self.path}: joint {axis} moves {less:.4g} kg less than the model says, but its '
                f'body has {own:.4g} kg: take mass off the bodies it carries'
            )
        element = self.text.parent(self._joint(axis))
        inertial = self.text.children(element, 'inertial')
        where = f'body of joint {axis}'
        if inertial:
            self.text.set(inertial[0], where, 'mass', written(own - less))
        else:
            values = {
                'pos': written(*model.body_ipos[body]),
                'quat': written(*model.body_iquat[body]),
                'mass': written(own - less),
                'diaginertia': written(*(model.body_inertia[body] * (1.0 - less / own))),
            }
            self.text.insert(element, where, 'inertial', values)
        for other, place in self.places.items():
            carrier = int(model.jnt_bodyid[place.joint])
            if carrier not in (body, *_carriers(model, body)):
                continue
            self._lifted[other] += less * float(model.opt.gravity @ self._directions[other])
            if other != axis:
                now = self._joint(other).attributes.get('armature')
                held = float(now or model.dof_armature[place.dof]) + less
                self.text.set(self._joint(other), f'joint {other}', 'armature', written(held))

    def _write_actuator(self, axis: str, old: Plant, new: Plant) -> None:
        where, k = f'actuator of joint {axis}', self.places[axis].actuator
        gear = float(self.model.actuator_gear[k, 0]) * new.gain / old.gain
        gain = float(self.model.actuator_gainprm[k, 0])
        if differs(old.gain, new.gain):
            rest = self._actuator(axis).attributes.get('gear', '').split()[1:]
            self._set(axis, where, 'gear', ' '.join([written(gear), *rest]))
        if differs(old.limit, new.limit) and math.isfinite(new.limit):
            self._set(axis, where, 'forcelimited', 'true')
            bound = new.limit * abs(gain)
            self._set(axis, where, 'forcerange', written(-bound, bound))
        bias = self._bias(axis)
        outside = old.offset - bias * float(self.model.actuator_gear[k, 0]) - self._lifted[axis]
        if differs(bias, (new.offset - outside) / gear):
            self._general(axis)
            self._set(axis, where, 'biastype', 'affine')
            self._set(axis, where, 'biasprm', written((new.offset - outside) / gear, 0.0, 0.0))
        if differs(old.lag, new.lag):
            self._general(axis)
            self._set(axis, where, 'dyntype', 'filterexact')
            self._set(axis, where, 'dynprm', written(new.lag))
        if differs(old.delay, new.delay) and hasattr(self.model, 'actuator_delay'):
            steps = math.ceil(new.delay / min(self.model.opt.timestep, FINEST)) + 1
            self._set(axis, where, 'delay', written(new.delay))
            self._set(axis, where, 'nsample', str(steps))

    def _set(self, axis: str, where: str, attribute: str, value: str) -> None:
        self.text.set(self._actuator(axis), where, attribute, value)

    def _general(self, axis: str) -> None:
        """Make the actuator a <general>, which alone has a bias and a filter."""
        element = self._actuator(axis)
        if element.tag != 'general':
            self.text.rename(element, 'general')


#: s, finest step for which a delay keeps its samples.
FINEST = 2.5e-4


def _carriers(model: Any, body: int) -> set[int]:
    """The bodies that carry a body."""
    out = set()
    while (body := int(model.body_parentid[body])) > 0:
        out.add(body)
    return out


def differs(old: float, new: float) -> bool:
    """Whether a value of the file has to change."""
    if math.isinf(old) or math.isinf(new):
        return old != new
    return abs(new - old) > SAME * max(abs(old), abs(new), 1e-6)


def written(*values: float) -> str:
    """Numbers as they stand in the file: five digits are more than any estimate has."""
    return ' '.join(f'{value:.5g}' for value in values)
