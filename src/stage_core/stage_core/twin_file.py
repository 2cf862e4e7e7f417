"""The twin file: a machine's nominal parameters and its effects (docs/reference/interfaces.md)."""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping
from dataclasses import MISSING, asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import yaml

from stage_core.errors import StageError
from stage_core.names import refuse_unknown_keys
from stage_core.quantities import AXES
from stage_core.untrusted import file_text, yaml_mapping
from stage_core.whole_file import write_whole


@dataclass(frozen=True)
class ServoAxis:
    """One axis of the nominal servo twin; units as in docs/reference/interfaces.md."""

    mass: float  # kg
    viscous: float  # N·s/m
    encoder_resolution: float = 1.0e-6  # m
    lead: float = 0.010  # m
    position_gain: float = 40.0  # 1/s
    velocity_feedforward: float = 0.0
    velocity_gain: float = 3600.0  # N·s/m
    integral_gain: float = 90000.0  # N/m
    velocity_filter: float = 1200.0  # rad/s
    force_limit: float = 600.0  # N
    delay: float = 0.0  # s


@dataclass(frozen=True)
class StepperAxis:
    """One axis of a stepper stage: open loop, position in motor steps."""

    microstep: float = 0.047625e-6  # m
    lead: float = 0.0006096  # m
    max_speed: float = 0.104  # m/s
    acceleration: float = 0.5  # m/s²


@dataclass(frozen=True)
class ForceAxis:
    """One axis of a rig whose controller is unknown: its recorded force is the input."""

    mass: float  # kg
    viscous: float = 0.0  # N·s/m
    effort_unit: float = 1.0  # N per unit of recorded effort
    encoder_resolution: float = 1.0e-6  # m
    lead: float = 0.010  # m


Axis = ServoAxis | StepperAxis | ForceAxis


def nominal_mass(axis: Axis) -> tuple[float, float]:
    """Mass [kg] and viscous friction [N·s/m] of a servo or force axis."""
    assert isinstance(axis, (ServoAxis, ForceAxis))
    return axis.mass, axis.viscous


AXIS_TYPES: dict[str, type[Axis]] = {
    'servo': ServoAxis,
    'stepper': StepperAxis,
    'measured_force': ForceAxis,
}
KINDS = tuple(AXIS_TYPES)

#: Keys of an axis beyond its own: a rig described as a servo machine keeps its gains, unused.
_UNUSED: dict[str, frozenset[str]] = {
    'servo': frozenset(),
    'stepper': frozenset(),
    'measured_force': frozenset(f.name for f in fields(ServoAxis)),
}
#: What closes the loop: driver and plant take no default for these of a servo axis.
GAINS = ('position_gain', 'velocity_gain', 'integral_gain', 'velocity_filter', 'force_limit')
#: Keys of a twin file beside kind, axes, tracker and effects: numbers.
_NUMBERS = ('control_period', 'temperature_reference', 'repeatability')

#: Must be above zero: the plant or the controller divides by them.
POSITIVE = frozenset(
    {'mass', 'encoder_resolution', 'lead', 'velocity_filter', 'force_limit'}
    | {'microstep', 'max_speed', 'acceleration', 'effort_unit'}
)
#: Must not be below zero: nothing answers before its cause, nor scatters by less than nothing.
NOT_NEGATIVE = frozenset({'delay', 'repeatability'})


@dataclass(frozen=True)
class TrackerSpec:
    """The tracker: points per second [Hz] and noise, standard deviation per coordinate [m]."""

    rate: float = 100.0
    noise: float = 1.0e-6


@dataclass(frozen=True)
class TwinFile:
    """Content of a twin file; `effects` maps ``backlash.x`` to its parameters."""

    kind: str
    axes: dict[str, Axis]
    control_period: float = 0.001  # s
    tracker: TrackerSpec | None = None
    temperature_reference: float = 20.0  # °C
    effects: dict[str, dict[str, float]] = field(default_factory=dict)
    #: Four standard deviations of where a stepper's move ends [m].
    repeatability: float | None = None
    #: Whether the file states every gain of its servo axes; else those here are the built-in ones.
    gains_stated: bool = True

    @classmethod
    def nominal_servo(cls) -> TwinFile:
        """The nominal servo twin; y scales x's loop gains with its mass."""
        ratio = 8.0 / 18.0
        return cls(
            kind='servo',
            axes={
                'x': ServoAxis(mass=18.0, viscous=40.0),
                'y': ServoAxis(
                    mass=8.0,
                    viscous=30.0,
                    velocity_gain=3600.0 * ratio,
                    integral_gain=90000.0 * ratio,
                ),
            },
            tracker=TrackerSpec(),
        )

    @classmethod
    def load(cls, path: str | Path, with_gains: bool = False) -> TwinFile:
        """Read a twin file.

        Parameters
        ----------
        path
            The file.
        with_gains
            Whether a servo axis must state its gains: who closes the loop needs the machine's
            own; the diagnosis may take the built-in ones.

        Raises
        ------
        StageError
            If it is absent, no YAML, or holds what no twin file does; the message names the key.
        """
        what, remedy = f'twin file {path}', 'name a twin file as interfaces.md describes it'
        content = yaml_mapping(file_text(path, what, remedy), what, remedy)
        found = cls.from_dict(content, str(path))
        if with_gains and found.kind == 'servo':
            for axis in found.axes:
                for name in GAINS:
                    if name not in content['axes'][axis]:
                        raise StageError(
                            f'{path}: axes.{axis}.{name} is missing: add the gain of the machine'
                        )
        return found

    @classmethod
    def from_dict(cls, content: Mapping[str, Any], source: str = 'twin') -> TwinFile:
        """Check and take over the content of a twin file (see :meth:`load`)."""
        content = dict(content)
        kind = content.pop('kind', None)
        if kind not in KINDS:
            raise StageError(f'{source}: kind must be one of {", ".join(KINDS)}, got {kind!r}')
        refuse_unknown_keys(content, ('axes', 'tracker', 'effects', *_NUMBERS), source)
        axes_content = content.get('axes')
        if not isinstance(axes_content, dict) or not axes_content:
            raise StageError(f'{source}: axes must map x and y to their parameters')
        unknown = sorted(set(map(str, axes_content)) - set(AXES))
        if unknown:
            raise StageError(f'{source}: axes.{unknown[0]} is not an axis: use x and y')
        axes = {
            name: _axis(kind, axes_content[name], source, name)
            for name in AXES
            if name in axes_content
        }
        numbers = {
            name: _number(
                content[name],
                f'{source}: {name}',
                name == 'control_period',
                name not in NOT_NEGATIVE,
            )
            for name in _NUMBERS
            if name in content
        }
        stated = kind != 'servo' or all(set(GAINS) <= set(axes_content[name]) for name in axes)
        return cls(
            kind=kind,
            axes=axes,
            gains_stated=stated,
            tracker=_tracker(content.get('tracker'), source),
            effects=_effects(content.get('effects'), source),
            **numbers,
        )

    def to_dict(self) -> dict[str, Any]:
        """Content as plain mappings, ready for YAML or a bag's custom data."""
        content: dict[str, Any] = {
            'kind': self.kind,
            'control_period': self.control_period,
            'axes': {name: asdict(axis) for name, axis in self.axes.items()},
        }
        if not self.gains_stated:
            for axis in content['axes'].values():
                for gain in GAINS:
                    del axis[gain]
        if self.tracker is not None:
            content['tracker'] = asdict(self.tracker)
        content['temperature_reference'] = self.temperature_reference
        if self.effects:
            content['effects'] = copy.deepcopy(self.effects)
        if self.repeatability is not None:
            content['repeatability'] = self.repeatability
        return content

    def to_yaml(self) -> str:
        """Content as YAML text."""
        return str(yaml.safe_dump(self.to_dict(), sort_keys=False))

    def save(self, path: str | Path) -> None:
        """Write the twin file."""
        write_whole(path, self.to_yaml())

    def with_effects(self, effects: Mapping[str, Mapping[str, float]]) -> TwinFile:
        """The same machine with these effects added; one of the same name is replaced."""
        merged = copy.deepcopy(self.effects)
        merged.update({name: dict(values) for name, values in effects.items()})
        return replace(self, effects=merged)

    def servo(self, axis: str) -> ServoAxis:
        """Parameters of a servo axis.

        Raises
        ------
        StageError
            If the twin is of another kind or lacks the axis.
        """
        found = self.axes.get(axis)
        if not isinstance(found, ServoAxis):
            raise StageError(f'the twin has no servo axis {axis}: give a twin file of kind servo')
        return found


def _axis(kind: str, content: Any, source: str, axis: str) -> Axis:
    where = f'{source}: axes.{axis}'
    if not isinstance(content, dict):
        raise StageError(f'{where} must hold the parameters of the axis')
    known = {f.name: f for f in fields(AXIS_TYPES[kind])}
    refuse_unknown_keys(content, known.keys() | _UNUSED[kind], source, f'axes.{axis}.')
    values: dict[str, float] = {}
    for name, value in content.items():
        number = _number(value, f'{where}.{name}', name in POSITIVE, name not in NOT_NEGATIVE)
        if name in known:
            values[name] = number
    for name, key in known.items():
        if key.default is MISSING and name not in values:
            raise StageError(
                f'{where}.{name} is missing: add it (docs/reference/interfaces.md, "Twin file")'
            )
    return AXIS_TYPES[kind](**values)


def _tracker(content: Any, source: str) -> TrackerSpec | None:
    if content is None:
        return None
    if not isinstance(content, dict):
        raise StageError(f'{source}: tracker must hold rate and noise')
    refuse_unknown_keys(content, [f.name for f in fields(TrackerSpec)], source, 'tracker.')
    return TrackerSpec(
        rate=_number(content.get('rate', TrackerSpec.rate), f'{source}: tracker.rate', True),
        noise=_number(
            content.get('noise', TrackerSpec.noise), f'{source}: tracker.noise', negative=False
        ),
    )


def _effects(content: Any, source: str) -> dict[str, dict[str, float]]:
    if content is None:
        return {}
    if not isinstance(content, dict):
        raise StageError(f'{source}: effects must map names to parameters')
    effects: dict[str, dict[str, float]] = {}
    for name, values in content.items():
        if not isinstance(values, dict):
            raise StageError(f'{source}: effects.{name} must hold the parameters of the effect')
        effects[str(name)] = {
            str(k): _number(v, f'{source}: effects.{name}.{k}') for k, v in values.items()
        }
    return effects


def _number(value: Any, where: str, positive: bool = False, negative: bool = True) -> float:
    # YAML 1.1 reads 1e-6 (no dot) as text; users write it all the same.
    try:
        number = float(value) if not isinstance(value, bool) else math.nan
    except (TypeError, ValueError):
        number = math.nan
    if not math.isfinite(number):
        raise StageError(f'{where} must be a finite number, got {value!r}')
    if positive and number <= 0.0:
        raise StageError(f'{where} must be above zero, got {value!r}')
    if number < 0.0 and not negative:
        raise StageError(f'{where} must be at least zero, got {value!r}')
    return number
