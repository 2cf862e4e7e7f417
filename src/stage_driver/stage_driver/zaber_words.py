"""Plain words for the warning flags and rejections of Zaber devices (interfaces_zaber.md)."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Flag:
    """Meaning of a two-letter warning flag and what ends it."""

    code: str
    meaning: str
    remedy: str

    @property
    def severity(self) -> str:
        """`fault`, `warning` or `note`: the first letter says it."""
        return {'F': 'fault', 'W': 'warning', 'N': 'note'}.get(self.code[0], 'unknown')


_CLEAR = 'clear the warnings with ~/reset_fault'

FLAGS = {
    flag.code: flag
    for flag in (
        Flag('FF', 'critical system error', 'switch the device off and on, else ask its maker'),
        Flag('FN', 'peripheral not supported', 'connect a supported peripheral'),
        Flag('FZ', 'peripheral inactive', 'set the peripheral id'),
        Flag('FH', 'hardware emergency stop, driver off', 'release the stop, then ~/enable'),
        Flag(
            'FV',
            'supply over or under voltage, driver off',
            'check the supply, then ~/enable',
        ),
        Flag('FO', 'driver disabled by command or at start-up', 'enable the driver with ~/enable'),
        Flag(
            'FD',
            'driver disabled (overheated or by command)',
            'let it cool, then ~/enable',
        ),
        Flag('FC', 'inrush current too high', 'check the supply'),
        Flag('FM', 'motor too hot', 'let it cool'),
        Flag('FQ', 'encoder error', _CLEAR + ', then home'),
        Flag('FI', 'encoder index error', _CLEAR + ', then home'),
        Flag('FS', 'stalled and stopped', 'remove the obstacle, then ' + _CLEAR),
        Flag('FB', 'stream left its bounds', _CLEAR),
        Flag('FP', 'path deviation too large', _CLEAR),
        Flag('FE', 'limit sensor cannot be reached', 'check the travel, then ' + _CLEAR),
        Flag('FR', 'overdrive limit exceeded', 'lower the load, then ' + _CLEAR),
        Flag('FT', 'lockstep twist too large', _CLEAR),
        Flag('WL', 'unexpected limit sensor trigger', 'check the limits, then ' + _CLEAR),
        Flag('WH', 'has a reference but is not homed', 'home with ~/home'),
        Flag('WR', 'no reference position', 'home with ~/home'),
        Flag('WP', 'calibration of another type', 'check the calibration'),
        Flag('WV', 'supply voltage out of range', 'check the supply'),
        Flag('WT', 'controller temperature high', 'let it cool'),
        Flag('WS', 'stalled, recovered by itself', 'lower speed or load'),
        Flag('WM', 'displaced while at rest', 'the next move clears it'),
        Flag('NC', 'moved by hand (manual control)', 'the next move clears it'),
        Flag('NI', 'movement interrupted by another command', 'the next move from rest clears it'),
        Flag('ND', 'stream starved', 'queue faster'),
        Flag('NR', 'value rounded', 'no action needed'),
        Flag('NT', 'value truncated', 'no action needed'),
        Flag('NU', 'setting update pending', 'no action needed'),
        Flag('NJ', 'joystick calibrating', 'finish the calibration'),
        Flag('NB', 'firmware update pending', 'finish the update'),
    )
}

REJECTIONS = {
    'AGAIN': 'busy for the moment, try again',
    'BADAXIS': 'no such axis on this device',
    'BADCOMMAND': 'unknown command or setting',
    'BADDATA': 'value wrong or out of range',
    'BADMESSAGEID': 'message id not valid',
    'DEVICEONLY': 'the command is for the whole device',
    'AXISONLY': 'the command is for one axis',
    'DRIVERDISABLED': 'the driver is disabled',
    'FULL': 'no room left',
    'INACTIVE': 'the axis is not active',
    'LOCKSTEP': 'the axis is part of a lockstep group',
    'NOACCESS': 'needs advanced access (system.access 2)',
    'NOTSUPPORTED': 'not supported by this device',
    'PARKED': 'the axis is parked',
    'REMOTE': 'under remote control',
    'STATUSBUSY': 'not while the axis moves',
    'BRAKECLOSED': 'the brake is closed',
}


def describe_flag(code: str) -> str:
    """`FS` -> `FS (fault): stalled and stopped; remove the obstacle, then ...`."""
    flag = FLAGS.get(code)
    if flag is None:
        return f'{code}: unknown warning flag'
    return f'{flag.code} ({flag.severity}): {flag.meaning}; {flag.remedy}'


def describe_rejection(reason: str) -> str:
    """`BADDATA` -> `BADDATA: value wrong or out of range`."""
    return f'{reason}: {REJECTIONS.get(reason, "unknown reason")}'
