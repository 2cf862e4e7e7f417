"""Every parameter of the stage driver, and the backends' configurations made from them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields
from typing import Any

import numpy as np

from stage_core.errors import StageError
from stage_core.parameters import THREAD_PRIORITY, Parameter
from stage_core.quantities import AXES
from stage_core.twin_file import StepperAxis, TwinFile
from stage_driver.config import DriverConfig, ServoConfig, ZaberConfig
from stage_driver.limits import AxisLimits

Values = Callable[[str], Any]


def _fixed(name: str, default: Any, description: str, unit: str = '', **bounds: Any) -> Parameter:
    """Parameter that the running driver does not change."""
    return Parameter(name, default, description, unit, read_only=True, **bounds)


def _of(
    config: type[DriverConfig], name: str, description: str, unit: str = '', **bounds: Any
) -> Parameter:
    """Such a parameter that is a field of a configuration, which has its default."""
    return _fixed(name, getattr(config, name), description, unit, **bounds)


def _axis_parameters(axis: str, number: int) -> list[Parameter]:
    return [
        _fixed(f'{axis}.limit_lower', -0.15, 'lower soft limit of the position', 'm'),
        _fixed(f'{axis}.limit_upper', 0.15, 'upper soft limit of the position', 'm'),
        _fixed(f'{axis}.max_velocity', 0.2, 'speed limit in every mode', 'm/s', minimum=1e-6),
        _fixed(f'{axis}.max_acceleration', 2.0, 'acceleration of moves', 'm/s^2', minimum=1e-4),
        _fixed(f'{axis}.stop_deceleration', 4.0, 'deceleration of stops', 'm/s^2', minimum=1e-4),
        _fixed(
            f'{axis}.coulomb_force',
            0.0,
            'servo: Coulomb friction of the compensation',
            'N',
            minimum=0.0,
        ),
        _fixed(
            f'{axis}.static_force',
            0.0,
            'servo: static friction of the compensation',
            'N',
            minimum=0.0,
        ),
        _fixed(
            f'{axis}.stribeck_velocity', 0.001, 'servo: Stribeck velocity', 'm/s', minimum=1e-6
        ),
        _fixed(f'{axis}.presliding', 2e-6, 'servo: presliding distance', 'm', minimum=1e-9),
        _fixed(
            f'{axis}.device',
            number,
            'zaber: address of the device in the chain',
            minimum=1,
            maximum=99,
        ),
        _fixed(f'{axis}.device_axis', 1, 'zaber: axis of that device', minimum=1, maximum=9),
        _fixed(
            f'{axis}.microstep',
            StepperAxis.microstep,
            'zaber: size of a microstep',
            'm',
            minimum=1e-12,
        ),
    ]


PARAMETERS: tuple[Parameter, ...] = (
    THREAD_PRIORITY,
    _fixed('backend', 'servo', 'what drives the stage', choices=('servo', 'zaber')),
    _fixed('axes', list(AXES), 'axes of the stage, of x and y'),
    _of(
        DriverConfig,
        'enable_on_start',
        'enable when the stage is found and after ~/reset_fault, unless ~/enable said no',
    ),
    _of(DriverConfig, 'home_required', 'refuse to move before homing'),
    _of(ServoConfig, 'homing_velocity', 'speed of homing (servo)', 'm/s', minimum=1e-5),
    _of(
        DriverConfig,
        'setpoint_timeout',
        'a stream stops when no set-point came for this time',
        's',
        minimum=0.002,
        maximum=10.0,
    ),
    _fixed('twin', '', 'servo: nominal twin file with the gains; empty is the built-in one'),
    _of(ServoConfig, 'drive_host', 'servo: host of the drive link'),
    _of(ServoConfig, 'drive_port', 'servo: UDP port of the drive link', minimum=1, maximum=65535),
    _of(
        DriverConfig,
        'drive_timeout',
        'longest wait of ~/home for a drive or port that is not there yet',
        's',
        minimum=0.0,
    ),
    _of(ServoConfig, 'max_jerk', 'servo: jerk of moves', 'm/s^3', minimum=0.01),
    _of(
        DriverConfig,
        'settle_time',
        'dwell that ends a move (zaber: in lockstep)',
        's',
        minimum=0.0,
        maximum=60.0,
    ),
    _of(
        ServoConfig,
        'following_error_limit',
        'servo: following error that latches a fault',
        'm',
        minimum=1e-6,
    ),
    _of(
        DriverConfig,
        'link_timeout',
        'silence of the drive or device that latches a fault',
        's',
        minimum=0.05,
    ),
    _of(
        DriverConfig,
        'lockstep_timeout',
        'lockstep: wall time that a tick waits for its set-point',
        's',
        minimum=0.1,
    ),
    _fixed('port', '', 'zaber: serial device, pseudo-terminal or URL such as socket://host:55550'),
    _of(ZaberConfig, 'baud', 'zaber: baud rate', minimum=9600, maximum=921600),
    _of(
        ZaberConfig,
        'rate',
        'zaber: polls and streamed set-points a second',
        'Hz',
        minimum=1.0,
        maximum=200.0,
    ),
    _of(ZaberConfig, 'reply_timeout', 'zaber: longest wait for a reply', 's', minimum=0.01),
    _of(ZaberConfig, 'homing_timeout', 'zaber: longest homing', 's', minimum=1.0),
    _fixed(
        'friction_compensation',
        'none',
        'servo: friction feed-forward into vc',
        choices=('none', 'lugre'),
    ),
    *(
        parameter
        for number, axis in enumerate(AXES, 1)
        for parameter in _axis_parameters(axis, number)
    ),
)


def axes_of(value: Values) -> tuple[str, ...]:
    """The stage's axes.

    Raises
    ------
    StageError
        If they are not x, y or both.
    """
    axes = tuple(value('axes'))
    if not axes or len(set(axes)) != len(axes) or not set(axes) <= set(AXES):
        raise StageError(f'axes must be taken from {", ".join(AXES)}, got {list(axes)}')
    return axes


def limits_of(value: Values) -> tuple[AxisLimits, ...]:
    """Soft limits of the axes, checked."""
    names = ('limit_lower', 'limit_upper', 'max_velocity', 'max_acceleration', 'stop_deceleration')
    return tuple(
        AxisLimits(*(value(f'{axis}.{name}') for name in names)).checked(axis)
        for axis in axes_of(value)
    )


def servo_config(value: Values) -> ServoConfig:
    """Configuration of the servo backend from the parameters' values."""
    axes = axes_of(value)
    twin = (
        TwinFile.load(value('twin'), with_gains=True)
        if value('twin')
        else TwinFile.nominal_servo()
    )
    friction = None
    if value('friction_compensation') == 'lugre':
        names = ('coulomb_force', 'static_force', 'stribeck_velocity', 'presliding')
        friction = np.array([[value(f'{axis}.{name}') for name in names] for axis in axes])
        # Static friction below the Coulomb force has no meaning: at rest nothing would hold.
        friction[:, 1] = np.maximum(friction[:, 0], friction[:, 1])
    return ServoConfig(
        limits=limits_of(value),
        twin=twin,
        friction=friction,
        **_same_named(ServoConfig, value),
    )


def zaber_config(value: Values) -> ZaberConfig:
    """Configuration of the Zaber backend from the parameters' values.

    Raises
    ------
    StageError
        If no port is given, or two axes share an address.
    """
    axes = axes_of(value)
    if not value('port'):
        raise StageError('backend zaber needs parameter port, for example /dev/ttyUSB0')
    places = [(value(f'{axis}.device'), value(f'{axis}.device_axis')) for axis in axes]
    if len(set(places)) != len(places):
        raise StageError(f'two axes have the same device and device_axis: {places}')
    return ZaberConfig(
        limits=limits_of(value),
        devices=tuple(device for device, _ in places),
        device_axes=tuple(axis for _, axis in places),
        microsteps=tuple(value(f'{axis}.microstep') for axis in axes),
        **_same_named(ZaberConfig, value),
    )


def _same_named(config: type[DriverConfig], value: Values) -> dict[str, Any]:
    """Those fields of a configuration that are a parameter of the node."""
    names = {f.name for f in fields(config)} & {p.name for p in PARAMETERS} - {'axes', 'twin'}
    return {'axes': axes_of(value), **{name: value(name) for name in names}}
