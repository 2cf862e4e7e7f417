"""What the generators hand over: planted effects, and the record of one session."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from .machine import Machine
from .references import Reference


@dataclass(frozen=True)
class Planted:
    """One mechanism put into a machine.

    `parameters` hold the physical truth in the units and conventions of interfaces.md,
    `shape` what else describes it. `companions` are effects that may honestly be named beside it,
    `instead` those that no data of this kind can tell from it. `settings` are for the generator.
    """

    effect: str
    axis: str | None = None
    parameters: dict[str, float] = field(default_factory=dict)
    shape: dict[str, Any] = field(default_factory=dict)
    companions: tuple[str, ...] = ()
    instead: tuple[str, ...] = ()
    settings: dict[str, Any] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """The effect with its axis, as reports write it."""
        return self.named(self.effect)

    def named(self, effect: str) -> str:
        """Another effect on the same axis, or the name itself where it says its axis."""
        if '.' in effect:
            return effect
        return f'{effect}.{self.axis}' if self.axis else effect


@dataclass
class Record:
    """One session as it would be written: (ticks,) stamps [s] and (ticks, 2) columns in SI units.

    `motor` holds what the machine really did at the ticks [m], `force` what the controller asked
    for [N]; no bag carries them.
    """

    stamps: np.ndarray
    reference: np.ndarray
    reference_velocity: np.ndarray
    command: np.ndarray
    effort: np.ndarray
    encoder: np.ndarray
    velocity: np.ndarray
    tracker_stamps: np.ndarray
    tracker: np.ndarray
    temperature_stamps: np.ndarray
    temperatures: dict[str, np.ndarray]
    motor: np.ndarray
    force: np.ndarray


@dataclass(frozen=True)
class Wish:
    """What an effect is drawn for: the machine, its path, the axis (0 or 1), and how strong.

    `size` 1 is an ordinary strength; the case drawing raises it until the effect shows.
    """

    machine: Machine
    reference: Reference
    axis: int
    size: float

    @property
    def letter(self) -> str:
        """Name of the axis."""
        return 'xy'[self.axis]

    @property
    def nominal(self) -> Any:
        """The axis of the twin file."""
        return self.machine.axes[self.axis]

    @property
    def travelled(self) -> tuple[float, float]:
        """Least and greatest reference position of the axis [m]."""
        column = self.reference.position[:, self.axis]
        return float(column.min()), float(column.max())

    @property
    def speeds(self) -> tuple[float, float]:
        """RMS and greatest reference speed of the axis [m/s]."""
        column = np.abs(self.reference.velocity[:, self.axis])
        return float(np.sqrt(np.mean(column**2))), float(column.max())

    @property
    def forces(self) -> tuple[float, float]:
        """RMS and greatest force that the nominal axis needs for the path [N]."""
        column = self.reference.velocity[:, self.axis]
        acceleration = np.gradient(column, self.machine.control_period)
        force = self.nominal.mass * acceleration + self.nominal.viscous * column
        return float(np.sqrt(np.mean(force**2))), float(np.abs(force).max())


class Generator(Protocol):
    """A machine that plants effects of its own making."""

    AXIS_EFFECTS: tuple[str, ...]
    GLOBAL_EFFECTS: tuple[str, ...]
    MECHANISMS: tuple[str, ...]

    def draw(self, rng: np.random.Generator, effect: str, wish: Wish) -> list[Planted]:
        """The effect or mechanism with random structure; several where one cause has them all."""

    def simulate(
        self, machine: Machine, reference: Reference, planted: list[Planted], seed: int
    ) -> Record:
        """The session of a machine with all that is planted."""
