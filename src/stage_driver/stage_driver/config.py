"""What the backends are configured with, made from the node's parameters."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass

from stage_core import drive_link
from stage_core.arrays import Array
from stage_core.twin_file import StepperAxis, TwinFile
from stage_driver.limits import AxisLimits


@dataclass(frozen=True)
class DriverConfig:
    """Parameters of both backends, by their names; SI units, one limit per axis."""

    axes: tuple[str, ...]
    limits: tuple[AxisLimits, ...]
    _: KW_ONLY
    settle_time: float = 0.6
    setpoint_timeout: float = 0.1
    link_timeout: float = 1.0
    lockstep_timeout: float = 5.0
    drive_timeout: float = 60.0
    home_required: bool = True
    enable_on_start: bool = True


@dataclass(frozen=True)
class ServoConfig(DriverConfig):
    """Parameters of the servo backend; SI units."""

    twin: TwinFile
    drive_host: str = '127.0.0.1'
    drive_port: int = drive_link.DEFAULT_PORT
    homing_velocity: float = 0.05
    max_jerk: float = 100.0
    following_error_limit: float = 0.002
    friction: Array | None = None
    """(axes, 4) Coulomb force, static force [N], Stribeck velocity [m/s], presliding [m]."""


@dataclass(frozen=True)
class ZaberConfig(DriverConfig):
    """Parameters of the Zaber backend; SI units; tuples have one element per axis."""

    port: str
    devices: tuple[int, ...] = (1, 2)
    device_axes: tuple[int, ...] = (1, 1)
    microsteps: tuple[float, ...] = (StepperAxis.microstep, StepperAxis.microstep)
    baud: int = 115200
    rate: float = 50.0
    reply_timeout: float = 0.2
    homing_timeout: float = 120.0
