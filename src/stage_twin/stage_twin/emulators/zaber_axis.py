"""One emulated Zaber axis: native units, flags, homing, limits, over a stepper plant."""

from __future__ import annotations

from typing import Protocol

from stage_twin.emulators.zaber_lines import FLAG_ORDER

#: Speed values are microsteps/s times this (docs/reference/interfaces_zaber.md, "Units").
SPEED_UNIT = 1.6384
#: Acceleration values are microsteps/s^2 times this.
ACCELERATION_UNIT = 1.6384 / 10000.0

#: Flags that `warnings clear` removes; the others last as long as their cause.
CLEARABLE = frozenset({'FQ', 'FI', 'FS', 'FB', 'FP', 'FE', 'FR', 'FT', 'WL'})
#: Flags that stop a moving axis when they come up.
STOPPING = frozenset({'FF', 'FH', 'FV', 'FO', 'FD', 'FQ', 'FS', 'FE', 'WL'})
#: Flags with which the motor has no power: moves are refused.
POWERLESS = frozenset({'FF', 'FH', 'FV', 'FO', 'FD'})
#: Flags that the next move from rest removes.
UNTIL_NEXT_MOVE = frozenset({'NC', 'NI', 'WM', 'WS'})

ESTOP_FACTOR = 50.0

#: Travel of a 150 mm stage in microsteps of 0.047625 µm: `limit.min` and `limit.max`.
LIMITS = (0, 3149606)


class StepperPort(Protocol):
    """What the emulator asks of the plant; steps, steps/s, steps/s^2."""

    def move_abs(
        self, axis: int, steps: float, speed: float | None = None, accel: float | None = None
    ) -> None:
        """Start a move."""

    def stop(self, axis: int, accel: float | None = None) -> None:
        """Brake to rest."""

    def busy(self, axis: int) -> bool:
        """Whether the axis moves."""

    def position_steps(self, axis: int) -> int:
        """Motor position."""

    def velocity_steps(self, axis: int) -> float:
        """Motor speed."""

    def advance_to(self, time: float) -> None:
        """Let time pass up to `time` [s]."""


class Rejection(Exception):
    """A rejected command; the text is the reason word of the reply."""


class ZaberAxis:
    """Axis of an emulated device; positions in its own microsteps, zero at the home sensor."""

    def __init__(self, plant: StepperPort, index: int) -> None:
        self.plant = plant
        self.index = index
        self.flags: set[str] = {'WR'}
        self.slip = 0
        self.stall_at: int | None = None
        self._offset = plant.position_steps(index)
        self._homing = False
        self._moving = False
        self.values: dict[str, float] = {
            'maxspeed': 153600,
            'motion.accelonly': 205,
            'motion.decelonly': 205,
            'limit.min': LIMITS[0],
            'limit.max': LIMITS[1],
            'limit.approach.maxspeed': 80000,
            'resolution': 64,
            'peripheralid': 0,
            'peripheral.id': 0,
            'peripheral.serial': 0,
            'peripheral.hw.modified': 0,
            'driver.temperature': 35.0,
            'parking.state': 0,
        }
        self._motor_before = self._offset

    @property
    def position(self) -> int:
        """`pos`: microsteps from where the axis believes zero to be."""
        return self.plant.position_steps(self.index) - self._offset

    @property
    def busy(self) -> bool:
        """Whether the axis moves."""
        return self.plant.busy(self.index)

    @property
    def flag(self) -> str:
        """Highest-priority flag, `--` without any."""
        return highest(self.flags)

    def power_cycle(self) -> None:
        """Lose position, reference and temporary flags; the motor stops at once."""
        self.plant.stop(self.index, self._deceleration() * ESTOP_FACTOR)
        self._homing = self._moving = False
        self.flags = {'WR'}
        self._offset = self.plant.position_steps(self.index)

    def update(self) -> bool:
        """Follow the plant; whether a movement ended since the last call."""
        motor = self.plant.position_steps(self.index)
        stall = self.stall_at
        if (
            stall is not None
            and self.busy
            and min(motor, self._motor_before) <= stall <= max(motor, self._motor_before)
        ):
            self.raise_flag('FS')
        self._motor_before = motor
        if self.busy or not self._moving:
            return False
        self._moving = False
        if self._homing and motor == 0:
            self._offset = 0
            self.flags -= {'WR', 'WH'}
        return True

    def raise_flag(self, flag: str) -> None:
        """Inject a fault, warning or note."""
        self.flags.add(flag)
        if flag in STOPPING:
            self._homing = False
            self.plant.stop(self.index, self._deceleration() * ESTOP_FACTOR)

    def turn_knob(self, steps: int) -> None:
        """Move by hand; the axis notes it."""
        self.flags.add('NC')
        self.plant.move_abs(self.index, self.plant.position_steps(self.index) + steps)
        self._homing, self._moving = False, True

    def clear_warnings(self) -> None:
        """Remove what `warnings clear` removes."""
        self.flags -= CLEARABLE

    def home(self) -> None:
        """Run to the home sensor and take its place for zero."""
        self._begin()
        self._homing = True
        self.plant.move_abs(
            self.index,
            0,
            self.values['limit.approach.maxspeed'] / SPEED_UNIT,
            self._acceleration(),
        )

    def move(self, target: int, speed: float | None = None, accel: float | None = None) -> None:
        """Move to `target`; speed and acceleration in native units.

        Raises
        ------
        Rejection
            BADDATA for a target beyond the limits or a speed or acceleration that is not positive.
        """
        if not self.values['limit.min'] <= target <= self.values['limit.max']:
            raise Rejection('BADDATA')
        if (speed is not None and speed <= 0) or (accel is not None and accel <= 0):
            raise Rejection('BADDATA')
        self._begin()
        native = self.values['maxspeed'] if speed is None else speed
        steps_accel = self._acceleration() if accel is None else accel / ACCELERATION_UNIT
        self.plant.move_abs(self.index, target + self._offset, native / SPEED_UNIT, steps_accel)

    def move_velocity(self, velocity: float, accel: float | None = None) -> None:
        """Run at `velocity` until a limit; zero stops."""
        if velocity == 0:
            self.stop()
            return
        end = self.values['limit.max' if velocity > 0 else 'limit.min']
        self.move(int(end), abs(velocity), accel)

    def stop(self, at_once: bool = False) -> None:
        """Brake to rest: a movement command itself, so a moving axis notes NI."""
        if self.busy:
            self.flags.add('NI')
        self._homing = False
        factor = ESTOP_FACTOR if at_once else 1.0
        self.plant.stop(self.index, self._deceleration() * factor)

    def get(self, name: str) -> str:
        """Value of a setting as text; Rejection BADCOMMAND where there is none."""
        if name == 'pos':
            return str(self.position)
        if name == 'encoder.pos':
            return str(self.position + self.slip)
        if name == 'vel':
            return str(round(self.plant.velocity_steps(self.index) * SPEED_UNIT))
        if name == 'accel':
            name = 'motion.accelonly'
        if name == 'motion.busy':
            return str(int(self.busy))
        if name == 'limit.home.triggered':
            return str(int(self.plant.position_steps(self.index) <= 0))
        if name not in self.values:
            raise Rejection('BADCOMMAND')
        value = self.values[name]
        return f'{value:.1f}' if name == 'driver.temperature' else str(round(value))

    def set(self, name: str, text: str) -> None:
        """Change a setting; Rejection with the reason where that is impossible."""
        try:
            value = int(text)
        except ValueError:
            raise Rejection('BADDATA') from None
        if abs(value) > 1_000_000_000:
            raise Rejection('BADDATA')
        if name == 'pos':
            if self.busy:
                raise Rejection('STATUSBUSY')
            self._offset = self.plant.position_steps(self.index) - value
            self.flags -= {'WR'}
        elif name == 'accel':
            self.set('motion.accelonly', text)
            self.set('motion.decelonly', text)
        elif name in (
            'maxspeed',
            'motion.accelonly',
            'motion.decelonly',
            'limit.approach.maxspeed',
        ):
            if value <= 0:
                raise Rejection('BADDATA')
            self.values[name] = value
        elif name in ('limit.min', 'limit.max'):
            self.values[name] = value
        elif name in self.values:
            raise Rejection('NOACCESS')
        else:
            raise Rejection('BADCOMMAND')

    def _begin(self) -> None:
        """What every movement command does first."""
        if self.flags & POWERLESS:
            raise Rejection('DRIVERDISABLED')
        if self.values['parking.state']:
            raise Rejection('PARKED')
        if self.busy:
            self.flags.add('NI')
        else:
            self.flags -= UNTIL_NEXT_MOVE
        self._homing, self._moving = False, True

    def _acceleration(self) -> float:
        return self.values['motion.accelonly'] / ACCELERATION_UNIT

    def _deceleration(self) -> float:
        return self.values['motion.decelonly'] / ACCELERATION_UNIT


def highest(flags: set[str]) -> str:
    """Flag of highest priority, `--` without any."""
    return next((flag for flag in FLAG_ORDER if flag in flags), '--')
