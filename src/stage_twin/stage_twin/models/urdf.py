"""URDF models: prismatic joints `x`, `y` with their `<dynamics>`, read and mended."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

from stage_core.errors import StageError
from stage_core.quantities import AXES
from stage_twin.models.mjcf import differs, written
from stage_twin.models.plant import Plant
from stage_twin.models.xml_text import Element, XmlText


class Urdf:
    """A model of the stage; attributes as of :class:`stage_twin.models.mjcf.Mjcf`.

    Raises
    ------
    StageError
        If there is no prismatic joint `x` or `y`, or a link or number is missing.
    """

    form = 'URDF'

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self.text = XmlText(path)
        self.notes: list[str] = []
        there = [axis for axis in AXES if self._find(axis)]
        if not there:
            raise StageError(f'{path} has no prismatic joint named x or y: name the axes so')
        for axis in there:
            if self._joint(axis).attributes.get('type') != 'prismatic':
                raise StageError(f'{path}: joint {axis} is not prismatic: give it that type')
        self.plants = {axis: self._plant(axis) for axis in there}

    def _find(self, axis: str) -> Element | None:
        return self.text.find(lambda e: e.tag == 'joint' and e.attributes.get('name') == axis)

    def _joint(self, axis: str) -> Element:
        found = self._find(axis)
        assert found is not None
        return found

    def _plant(self, axis: str) -> Plant:
        limit = self._number(axis, 'limit', 'effort')
        return Plant(
            mass=sum(self._mass(link) for link in self._moved(axis)),
            viscous=self._number(axis, 'dynamics', 'damping'),
            coulomb=self._number(axis, 'dynamics', 'friction'),
            # By convention 0 stands for a limit that nobody has stated.
            limit=limit if limit > 0.0 else math.inf,
        )

    def _number(self, axis: str, tag: str, attribute: str) -> float:
        found = self.text.children(self._joint(axis), tag)
        text = found[0].attributes.get(attribute, '0') if found else '0'
        try:
            return float(text)
        except ValueError:
            raise StageError(
                f'{self.path}: {attribute} of joint {axis} is no number: {text!r}'
            ) from None

    def _link(self, joint: Element, which: str) -> str:
        found = self.text.children(joint, which)
        if not found:
            raise StageError(f'{self.path}: a joint has no <{which}>: name its link')
        return found[0].attributes.get('link', '')

    def _moved(self, axis: str) -> list[str]:
        """Links that move with a joint: its child and all that hangs on it."""
        joints = [e for e in self.text.elements if e.tag == 'joint' and len(e.path) == 1]
        out = [self._link(self._joint(axis), 'child')]
        for link in out:
            out += [self._link(j, 'child') for j in joints if self._link(j, 'parent') == link]
        return out

    def _mass_element(self, link: str) -> Element | None:
        owner = self.text.find(lambda e: e.tag == 'link' and e.attributes.get('name') == link)
        inertial = self.text.children(owner, 'inertial') if owner else []
        mass = self.text.children(inertial[0], 'mass') if inertial else []
        return mass[0] if mass else None

    def _mass(self, link: str) -> float:
        element = self._mass_element(link)
        return float(element.attributes['value']) if element else 0.0

    def write(self, wanted: Mapping[str, Plant]) -> str:
        """The model's text with other plants; :attr:`text` then holds what was changed."""
        self.text = XmlText(self.path)
        more = {axis: new.mass - self.plants[axis].mass for axis, new in wanted.items()}
        for axis in wanted:
            child = self._link(self._joint(axis), 'child')
            # What an axis carries has its own share of the difference already.
            carried = [a for a in wanted if a != axis and self._carries(axis, a)]
            added = more[axis] - sum(more[a] for a in carried)
            self._write_mass(axis, child, added)
            old, new = self.plants[axis], wanted[axis]
            for attribute, before, after in (
                ('damping', old.viscous, new.viscous),
                ('friction', old.coulomb, new.coulomb),
            ):
                if differs(before, after):
                    self._write(axis, 'dynamics', attribute, written(after))
            if differs(old.limit, new.limit):
                self._write(axis, 'limit', 'effort', written(new.limit))
        return self.text.text

    def _carries(self, axis: str, other: str) -> bool:
        return self._link(self._joint(other), 'child') in self._moved(axis)

    def _write_mass(self, axis: str, link: str, added: float) -> None:
        element = self._mass_element(link)
        own = self._mass(link)
        if not differs(own, own + added):
            return
        if element is None or own + added <= 0.0:
            raise StageError(
                f'{self.path}: link {link} of joint {axis} has {own:.4g} kg and should have '
                f'{own + added:.4g} kg: mend the masses of the links by hand'
            )
        self.text.set(element, f'mass of link {link}', 'value', written(own + added))

    def _write(self, axis: str, tag: str, attribute: str, value: str) -> None:
        found = self.text.children(self._joint(axis), tag)
        where = f'{tag} of joint {axis}'
        if found:
            self.text.set(found[0], where, attribute, value)
        else:
            self.text.insert(self._joint(axis), where, tag, {attribute: value})
