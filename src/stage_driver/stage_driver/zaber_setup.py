"""The first conversation with the devices of a Zaber chain."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from stage_core.errors import StageError
from stage_driver.config import ZaberConfig
from stage_driver.limits import AxisLimits
from stage_driver.protocol import Reply
from stage_driver.zaber_clock import WallClock
from stage_driver.zaber_link import NoAnswer, ZaberLink
from stage_driver.zaber_units import ZaberUnits
from stage_driver.zaber_words import describe_rejection


@dataclass(frozen=True)
class ZaberAxisHandle:
    """How to talk to one axis, and where it may go [microsteps]."""

    name: str
    device: int
    axis: int
    units: ZaberUnits
    lower: int
    upper: int
    braking: str
    """Setting that holds the deceleration of `stop`."""
    former_braking: int
    """Its value before the session."""

    def narrowed(self, limits: AxisLimits) -> AxisLimits:
        """Soft limits within the device's own travel."""
        return replace(
            limits,
            lower=max(limits.lower, self.units.metres(self.lower)),
            upper=min(limits.upper, self.units.metres(self.upper)),
        )


def connect(
    config: ZaberConfig, clock: WallClock, opened: Callable[[ZaberLink], object]
) -> tuple[ZaberLink, list[ZaberAxisHandle]]:
    """Open the port and prepare every device; nothing moves.

    Replies get checksums, the knob is switched off, stops brake as the limits say. `opened` is
    called before anything is asked.

    Raises
    ------
    StageError
        If the port cannot be opened, nobody answers, or what answers is no Zaber ASCII device.
    """
    link = ZaberLink(config.port, config.baud, config.reply_timeout, clock.line_sent)
    try:
        opened(link)
        for device in sorted(set(config.devices)):
            _greet(link, config, device)
        return link, [_handle(link, config, number) for number in range(len(config.axes))]
    except NoAnswer as error:
        link.close()
        raise StageError(f'{error}: check power and cable') from error
    except Exception:
        link.close()
        raise


def _greet(link: ZaberLink, config: ZaberConfig, device: int) -> None:
    try:
        link.ask('', device)
    except NoAnswer:
        if link.counts['garbage']:
            raise StageError(
                f'device at {config.port} answers garbage ({link.garbage_sample!r}): check the '
                f'baud rate ({config.baud}) and that it speaks Zaber ASCII'
            ) from None
        raise StageError(
            f'no answer from device {device} at {config.port}: check power, cable, address, the '
            f'baud rate ({config.baud}) and that it speaks ASCII, not Binary'
        ) from None
    # A device without knob or checksums rejects the setting: nothing is lost by that.
    link.ask('set comm.checksum 1', device)
    link.ask('set knob.enable 0', device)


def _handle(link: ZaberLink, config: ZaberConfig, number: int) -> ZaberAxisHandle:
    name, limits = config.axes[number], config.limits[number]
    device, axis = config.devices[number], config.device_axes[number]
    units = ZaberUnits(config.microsteps[number])
    lowest = integer(link.ask('get limit.min', device, axis), name)
    highest = integer(link.ask('get limit.max', device, axis), name)
    lower = max(lowest, units.steps(limits.lower))
    upper = min(highest, units.steps(limits.upper))
    if lower >= upper:
        raise StageError(
            f'soft limits of {name} {limits.lower} ... {limits.upper} m lie outside the travel of '
            f'its device, {units.metres(lowest):.6f} ... {units.metres(highest):.6f} m'
        )
    braking, former = _set_braking(link, config, number, units)
    return ZaberAxisHandle(name, device, axis, units, lower, upper, braking, former)


def _set_braking(
    link: ZaberLink, config: ZaberConfig, number: int, units: ZaberUnits
) -> tuple[str, int]:
    """Let `stop` brake by the limits of the axis; the setting's name and former value.

    By itself a device brakes at its own acceleration, as delivered 0.06 m/s^2: from 0.1 m/s the
    axis would run on for 83 mm, whatever soft limit lies ahead.
    """
    limits = config.limits[number]
    device, axis = config.devices[number], config.device_axes[number]
    # Never gentler than a move, or a stop would run past the target of the move that it ends.
    wanted = units.acceleration(max(limits.stop_deceleration, limits.max_acceleration))
    for name in ('motion.decelonly', 'accel'):
        former = link.ask(f'get {name}', device, axis)
        if former.accepted and link.ask(f'set {name} {wanted}', device, axis).accepted:
            return name, integer(former, config.axes[number])
    raise StageError(
        f'axis {config.axes[number]} takes no deceleration of stops (motion.decelonly, accel): '
        'see system.access of its device'
    )


def integer(reply: Reply, name: str) -> int:
    """Number in an accepted reply.

    Raises
    ------
    StageError
        If the request was rejected or the data is no whole number.
    """
    if not reply.accepted:
        raise StageError(f'axis {name} rejected a request: {describe_rejection(reply.data)}')
    try:
        return int(reply.data)
    except ValueError:
        raise StageError(f'axis {name} answered {reply.data[:40]!r} for a number') from None
