"""SpatialAnalyzer text datagrams: watch window as observed 2026, not confirmed by the vendor.

One datagram is one update, segments between ``|``::

    X,    3744.50, | Y,    1309.42, | Z,      54.65, | Units: (mm)

Labels are matched exactly (a real window also shows Rx, dX, Mag), unknown segments are skipped
and the order is free. There is no time stamp and no status: a lost beam shows as silence or as a
frozen value. The project's own line for a script in SpatialAnalyzer carries what is missing::

    SA1,<sequence>,<t_ms>,<x>,<y>,<z>,<unit>,<status>
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field

from stage_core.errors import StageError
from tracker_bridge.samples import Point, Sample

MAXIMUM_LENGTH = 8192
METRES_PER_UNIT = {
    'm': 1.0,
    'meters': 1.0,
    'cm': 1e-2,
    'centimeters': 1e-2,
    'mm': 1e-3,
    'millimeters': 1e-3,
    'um': 1e-6,
    'µm': 1e-6,
    'μm': 1e-6,
    'in': 0.0254,
    'inches': 0.0254,
    'ft': 0.3048,
    'feet': 0.3048,
}
_NUMBER = re.compile(r'[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?\Z', re.ASCII)
_UNIT = re.compile(r'Units\s*:\s*\(([^()]*)\)')


class SaTextError(StageError):
    """A datagram that gives no point; it is counted and skipped."""


@dataclass(frozen=True)
class SaFormat:
    """How the operator has set up SpatialAnalyzer.

    Attributes
    ----------
    labels
        Labels of x, y and z, matched exactly.
    decimal_comma
        Whether numbers are written ``3744,50``.
    unit
        Unit where the datagram names none; empty: such a datagram is refused.
    """

    labels: tuple[str, str, str] = ('X', 'Y', 'Z')
    decimal_comma: bool = False
    unit: str = 'mm'


def _number(text: str, comma: bool) -> float:
    """Read a displayed number; a separator that is not the decimal one is refused as ambiguous."""
    if comma:
        if '.' in text:
            raise SaTextError(
                f'number {text!r} holds a point although decimal_comma is set: check the locale'
            )
        text = text.replace(',', '.')
    if not _NUMBER.match(text):
        raise SaTextError(
            f'{text[:40]!r} is no number: check the locale of SpatialAnalyzer (decimal_comma)'
        )
    value = float(text)
    if not math.isfinite(value):
        raise SaTextError(f'{text[:40]!r} is too large a number: check the display of the window')
    return value


def _scale(unit: str) -> float:
    scale = METRES_PER_UNIT.get(unit.strip().lower())
    if scale is None:
        raise SaTextError(
            f'unit {unit[:20]!r} is not known: set one of {", ".join(METRES_PER_UNIT)}'
        )
    return scale


def parse_watch_window(text: str, form: SaFormat) -> tuple[Point, str]:
    """Return the point [m] and the unit's name of one watch-window datagram.

    Raises
    ------
    SaTextError
        When a coordinate or the unit is absent, doubled or unreadable.
    """
    found: dict[str, float] = {}
    unit = form.unit
    for segment in text.split('|'):
        match = _UNIT.search(segment)
        if match:
            unit = match[1].strip()
            continue
        label, comma, rest = segment.partition(',')
        label = label.strip()
        if not comma or label not in form.labels:
            continue
        if label in found:
            raise SaTextError(f'label {label} comes twice: give the window one point only')
        number = rest.strip()
        if number.endswith(','):
            number = number[:-1].rstrip()
        found[label] = _number(number, form.decimal_comma)
    missing = [label for label in form.labels if label not in found]
    if missing:
        raise SaTextError(f'no {", ".join(missing)} in the datagram: check the parameter labels')
    scale = _scale(unit)
    x, y, z = (found[label] * scale for label in form.labels)
    return (x, y, z), unit


def parse_script_line(text: str, receive_ns: int) -> tuple[Sample, str]:
    """Return the sample and the unit of an ``SA1`` line (see the module's text)."""
    fields = text.strip().split(',')
    if len(fields) != 8 or fields[0] != 'SA1':
        raise SaTextError('a line SA1 has eight fields: SA1,sequence,t_ms,x,y,z,unit,status')
    sequence, time_ms, *xyz = (_number(value.strip(), False) for value in fields[1:6])
    status = _number(fields[7].strip(), False)
    scale = _scale(fields[6])
    point = (xyz[0] * scale, xyz[1] * scale, xyz[2] * scale)
    # Nanoseconds of years still fit a stamp; more is a damaged number.
    if abs(time_ms) > 1e13 or abs(sequence) > 2**53 or abs(status) > 2**31:
        raise SaTextError('a number of the line SA1 is out of range: check the script')
    sample = Sample(point, receive_ns, round(time_ms * 1e6), int(status))
    return sample, fields[6]


def format_script_line(
    sequence: int, time_ns: int, point: Point, unit: str = 'mm', status: int = 0
) -> bytes:
    """Format an ``SA1`` line from a point [m] with 0.1 nm in mm."""
    x, y, z = (value / _scale(unit) for value in point)
    text = f'SA1,{sequence},{time_ns / 1e6:.6f},{x:.7f},{y:.7f},{z:.7f},{unit},{status}\n'
    return text.encode('ascii')


@dataclass
class SaTextDecoder:
    """Turn datagrams into samples and watch what text cannot say: its resolution.

    Attributes
    ----------
    quantum
        Smallest non-zero change of a coordinate seen [m]; inf before the first change.
    """

    form: SaFormat = field(default_factory=SaFormat)
    quantum: float = math.inf
    unit: str | None = None
    _point: Point | None = None

    def decode(self, datagram: bytes, receive_ns: int) -> Sample:
        """Return the sample of one datagram.

        Raises
        ------
        SaTextError
            When it holds no point, or another unit than the datagrams before it.
        """
        if len(datagram) > MAXIMUM_LENGTH:
            raise SaTextError(f'datagram of {len(datagram)} bytes: check what sends to this port')
        try:
            text = datagram.decode('utf-8')
        except UnicodeDecodeError:
            text = datagram.decode('latin-1')
        if text.startswith('SA1'):
            sample, unit = parse_script_line(text, receive_ns)
        else:
            point, unit = parse_watch_window(text, self.form)
            sample = Sample(point, receive_ns)
        if self.unit is not None and unit != self.unit:
            raise SaTextError(
                f'the unit changed from {self.unit} to {unit}: set it back or call ~/reset'
            )
        self.unit = unit
        self._measure_quantum(sample.point)
        return sample

    def _measure_quantum(self, point: Point) -> None:
        if self._point is not None:
            # Below a picometre a difference is the rounding of doubles, not of the display.
            steps = [abs(a - b) for a, b in zip(point, self._point, strict=True) if a != b]
            self.quantum = min([self.quantum, *(step for step in steps if step > 1e-12)])
        self._point = point
