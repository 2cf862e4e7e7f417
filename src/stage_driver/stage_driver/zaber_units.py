"""Native units of a Zaber axis: microsteps, and the 1.6384 factors of speed and acceleration."""

from __future__ import annotations

from dataclasses import dataclass

SPEED_FACTOR = 1.6384
"""Speed value per microstep/s (docs/reference/interfaces_zaber.md, "Units")."""
ACCELERATION_FACTOR = 1.6384 / 10000.0
"""Acceleration value per microstep/s^2."""


@dataclass(frozen=True)
class ZaberUnits:
    """Conversions for one microstep size [m]."""

    microstep: float

    def steps(self, position: float) -> int:
        """Position [m] in whole microsteps, to nearest."""
        return round(position / self.microstep)

    def metres(self, steps: float) -> float:
        """Microsteps in m."""
        return steps * self.microstep

    def speed(self, velocity: float) -> int:
        """Speed value of |velocity| [m/s]; at least 1, since 0 is refused by `move abs`."""
        return max(1, round(abs(velocity) / self.microstep * SPEED_FACTOR))

    def acceleration(self, acceleration: float) -> int:
        """Acceleration value of [m/s^2]; at least 1."""
        return max(1, round(acceleration / self.microstep * ACCELERATION_FACTOR))
