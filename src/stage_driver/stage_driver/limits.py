"""What a set-point must keep to be executed: names, finite numbers, travel, speed."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

from stage_core.errors import StageError


class SetpointKind(Enum):
    """Which fields of the JointState are filled (docs/reference/interfaces.md, "Set-points")."""

    POSITION = 'position'
    VELOCITY = 'velocity'
    BOTH = 'both'


@dataclass(frozen=True)
class AxisLimits:
    """Soft limits of one axis; SI units."""

    lower: float  # m
    upper: float  # m
    max_velocity: float  # m/s
    max_acceleration: float  # m/s²
    stop_deceleration: float  # m/s²

    def checked(self, axis: str) -> AxisLimits:
        """Return the limits themselves.

        Raises
        ------
        StageError
            If they are empty or not positive where they must be.
        """
        if not self.lower < self.upper:
            raise StageError(
                f'limits of {axis}: {axis}.limit_lower {self.lower} must be below '
                f'{axis}.limit_upper {self.upper}'
            )
        for name in ('max_velocity', 'max_acceleration', 'stop_deceleration'):
            if not getattr(self, name) > 0.0:
                raise StageError(f'{axis}.{name} must be above zero, got {getattr(self, name)}')
        return self


@dataclass(frozen=True)
class Setpoint:
    """A checked set-point; positions [m] and velocities [m/s] per axis, None where not given."""

    kind: SetpointKind
    stamp: int
    positions: tuple[float | None, ...]
    velocities: tuple[float | None, ...]

    @property
    def named(self) -> tuple[bool, ...]:
        """Whether each axis is given a value."""
        values = zip(self.positions, self.velocities, strict=True)
        return tuple(value != (None, None) for value in values)

    @property
    def streams(self) -> bool:
        """Whether it belongs to a stream that must be refreshed."""
        return self.kind is not SetpointKind.POSITION


def check_setpoint(
    axes: Sequence[str],
    limits: Sequence[AxisLimits],
    stamp: int,
    names: Sequence[str],
    positions: Sequence[float],
    velocities: Sequence[float],
) -> Setpoint:
    """Set-point of a JointState's fields.

    Raises
    ------
    StageError
        If it names an unknown axis, has arrays of the wrong size, holds NaN or infinity, or leaves
        the limits; the message names axis, value and limit.
    """
    same = tuple(names) == tuple(axes)
    unknown = [] if same else [name for name in names if name not in axes]
    if unknown or not names or len(set(names)) != len(names):
        # Made up names may be many.
        shown = ', '.join(map(repr, (unknown or list(names))[:4])) or 'none'
        raise StageError(f'set-point refused: its axes ({shown}) are not among {", ".join(axes)}')
    for field, values in (('positions', positions), ('velocities', velocities)):
        if len(values) not in (0, len(names)):
            raise StageError(
                f'set-point refused: {len(values)} {field} for {len(names)} names: give one per '
                'name, or none'
            )
    if not len(positions) and not len(velocities):
        raise StageError('set-point refused: it holds neither positions nor velocities')
    for index, name in enumerate(names):
        _check_axis(
            name,
            limits[axes.index(name)],
            positions[index] if len(positions) else None,
            velocities[index] if len(velocities) else None,
        )
    kind = SetpointKind.VELOCITY
    if len(positions):
        kind = SetpointKind.BOTH if len(velocities) else SetpointKind.POSITION
    return Setpoint(
        kind,
        stamp,
        tuple(positions) if same and len(positions) else _by_axis(axes, names, positions),
        tuple(velocities) if same and len(velocities) else _by_axis(axes, names, velocities),
    )


def _check_axis(
    name: str, limits: AxisLimits, position: float | None, velocity: float | None
) -> None:
    if position is not None:
        if not math.isfinite(position):
            raise StageError(f'set-point refused: position of {name} is {position}')
        if not limits.lower <= position <= limits.upper:
            raise StageError(
                f'set-point refused: position of {name} {position:.6f} m is outside its limits '
                f'{limits.lower:.6f} ... {limits.upper:.6f} m'
            )
    if velocity is not None:
        if not math.isfinite(velocity):
            raise StageError(f'set-point refused: velocity of {name} is {velocity}')
        if abs(velocity) > limits.max_velocity:
            raise StageError(
                f'set-point refused: velocity of {name} {velocity:.6f} m/s is beyond its limit '
                f'{limits.max_velocity:.6f} m/s'
            )


def _by_axis(
    axes: Sequence[str], names: Sequence[str], values: Sequence[float]
) -> tuple[float | None, ...]:
    given = dict(zip(names, (float(value) for value in values), strict=False))
    return tuple(given.get(axis) for axis in axes)
