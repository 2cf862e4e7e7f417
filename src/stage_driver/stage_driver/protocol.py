"""Zaber ASCII lines as records: pure functions from bytes to data and back.

Frames (docs/reference/interfaces_zaber.md, "Framing"):

    command  /[address [axis [id]]] words[:CC]            host   -> device, ended by LF
    reply    @AA A [II ]OK|RJ BUSY|IDLE WW data[:CC]      device -> host, ended by CR LF
    info     #AA A [II ][cont ]text[:CC]
    alert    !AA A BUSY|IDLE WW[ data][:CC]               never carries a message id

`CC` is the two's complement of the byte sum between the start character and the colon. A device's
packet that ends with a backslash before the checksum goes on in `cont` packets.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

PACKET_SIZE = 80
"""Longest packet [bytes], counted from the start character to the line feed."""
LONGEST_LINE = 512
"""A longer run of bytes without a line end is noise: it is dropped, so memory stays bounded."""
LONGEST_MESSAGE = 4096
"""Longest joined text of a message with its continuations [characters]."""
LARGEST_ID = 99

_RESERVED = re.compile(r'[/@#!:\\\r\n]')
_LINE_ENDS = re.compile(rb'[\r\n]+')
_PREFIX = re.compile(r'([@#!])(\d{1,2}) (\d)(?: (.*))?$', re.DOTALL)
_STATUS = re.compile(r'(BUSY|IDLE) ([A-Z]{2}|--)(?: (.*))?$', re.DOTALL)
_ID = re.compile(r'(\d\d)(?: (.*))?$', re.DOTALL)


class ProtocolError(Exception):
    """A line that no Zaber device sends, or a command that none would take."""


@dataclass(frozen=True)
class Reply:
    """Answer to one command; `data` is `0` when there is nothing else to say."""

    device: int
    axis: int
    message_id: int | None
    accepted: bool
    busy: bool
    flag: str
    data: str
    unfinished: bool = False


@dataclass(frozen=True)
class Info:
    """Additional line of an answer; `continues` marks the rest of an unfinished packet."""

    device: int
    axis: int
    message_id: int | None
    data: str
    continues: bool = False
    unfinished: bool = False


@dataclass(frozen=True)
class Alert:
    """Unsolicited line at the end of a movement."""

    device: int
    axis: int
    data: str
    unfinished: bool = False


Answer = Reply | Info | Alert


def checksum(body: bytes) -> int:
    """Longitudinal redundancy check of the bytes between start character and colon, 0..255."""
    return -sum(body) & 0xFF


def encode_command(
    words: str, device: int = 0, axis: int = 0, message_id: int | None = None
) -> bytes:
    """Bytes of a command with its checksum.

    Raises
    ------
    ProtocolError
        If address, axis or id are out of range, `words` holds a reserved or unprintable character,
        or does not fit into a packet. Nothing that the driver sends is longer.
    """
    if not 0 <= device <= 99 or not 0 <= axis <= 9:
        raise ProtocolError(f'address {device} {axis} is outside 0..99 and 0..9')
    if message_id is not None and not 0 <= message_id <= LARGEST_ID:
        raise ProtocolError(f'message id {message_id} is outside 0..{LARGEST_ID}')
    if _RESERVED.search(words) or not words.isascii() or (words and not words.isprintable()):
        raise ProtocolError(f'a command cannot hold reserved or unprintable characters: {words!r}')
    number = '' if message_id is None else f'{message_id:02d}'
    body = ' '.join(filter(None, [str(device), str(axis), number, words])).encode('ascii')
    packet = b'/%b:%02X\n' % (body, checksum(body))
    if len(packet) > PACKET_SIZE:
        raise ProtocolError(f'{words!r} is longer than a packet of {PACKET_SIZE} bytes')
    return packet


def decode_answer(line: bytes) -> Answer:
    """Record of one line that a device sent (with or without its line end).

    Raises
    ------
    ProtocolError
        For anything that is not a well-formed reply, info or alert with the right checksum. No
        other exception leaves this function, whatever the bytes.
    """
    body = line.strip(b'\r\n')
    if len(body) > LONGEST_LINE:
        raise ProtocolError(f'a line of {len(body)} bytes is longer than {LONGEST_LINE}')
    body = _without_checksum(body)
    try:
        text = body.decode('ascii')
    except UnicodeDecodeError:
        raise ProtocolError(f'not an ASCII line: {line[:60]!r}') from None
    unfinished = text.endswith('\\')
    prefix = _PREFIX.match(text[:-1] if unfinished else text)
    if prefix is None:
        raise ProtocolError(f'not an answer of a Zaber ASCII device: {line[:60]!r}')
    kind, device, axis, rest = prefix[1], int(prefix[2]), int(prefix[3]), prefix[4] or ''
    if kind == '!':
        *_, data = _status(rest, line)
        return Alert(device, axis, data, unfinished)
    message_id = None
    if numbered := _ID.match(rest):
        message_id, rest = int(numbered[1]), numbered[2] or ''
    if kind == '#':
        continues = rest == 'cont' or rest.startswith('cont ')
        data = rest[5:] if continues else rest
        return Info(device, axis, message_id, data, continues, unfinished)
    verdict, _, rest = rest.partition(' ')
    if verdict not in ('OK', 'RJ'):
        raise ProtocolError(f'a reply says neither OK nor RJ: {line[:60]!r}')
    busy, flag, data = _status(rest, line)
    return Reply(device, axis, message_id, verdict == 'OK', busy, flag, data, unfinished)


def _without_checksum(body: bytes) -> bytes:
    """Body without `:CC`, after checking it."""
    head, colon, digits = body.rpartition(b':')
    if not colon:
        return body
    # int() alone would take signs, blanks and underscores.
    if not re.fullmatch(rb'[0-9A-Fa-f]{2}', digits) or int(digits, 16) != checksum(head[1:]):
        raise ProtocolError(f'wrong checksum: {body[:60]!r}')
    return head


def _status(rest: str, line: bytes) -> tuple[bool, str, str]:
    """`BUSY|IDLE WW data` as (busy, flag, data)."""
    match = _STATUS.match(rest)
    if match is None:
        raise ProtocolError(f'no BUSY or IDLE with a warning flag: {line[:60]!r}')
    return match[1] == 'BUSY', match[2], match[3] or ''


class LineSplitter:
    """Cuts a byte stream into lines; CR, LF and any mix end a line; memory is bounded."""

    def __init__(self) -> None:
        self._rest = b''
        self._overlong = False

    def feed(self, received: bytes) -> list[bytes]:
        """Complete, non-empty lines in order; an overlong one is dropped."""
        pieces = _LINE_ENDS.split(self._rest + received)
        self._rest = pieces.pop()
        lines = []
        for piece in pieces:
            if piece and not self._overlong and len(piece) <= LONGEST_LINE:
                lines.append(piece)
            self._overlong = False
        if len(self._rest) > LONGEST_LINE:
            self._rest, self._overlong = b'', True
        return lines


class Assembler:
    """Joins continuation packets with their beginnings, whatever comes between them."""

    def __init__(self) -> None:
        self._open: dict[tuple[int, int, int | None], Answer] = {}

    def add(self, answer: Answer) -> Answer | None:
        """Return the whole message when `answer` completes one, else None.

        Raises
        ------
        ProtocolError
            For a continuation without a beginning, or a message beyond `LONGEST_MESSAGE`.
        """
        message_id = None if isinstance(answer, Alert) else answer.message_id
        key = (answer.device, answer.axis, message_id)
        if isinstance(answer, Info) and answer.continues:
            start = self._open.pop(key, None)
            if start is None:
                raise ProtocolError(f'continuation of device {answer.device} without a beginning')
            joined = f'{start.data} {answer.data}'
            if len(joined) > LONGEST_MESSAGE:
                raise ProtocolError(f'message of device {answer.device} is too long')
            answer = replace(start, data=joined, unfinished=answer.unfinished)
        if not answer.unfinished:
            return answer
        # At most one open message per address, axis and id, so the table is bounded.
        self._open[key] = answer
        return None


def warning_list(data: str) -> tuple[str, ...]:
    """Flags in the answer to `warnings`: `02 FS WR` -> ('FS', 'WR').

    Raises
    ------
    ProtocolError
        If the count does not fit the list.
    """
    count, *flags = data.split() or ['']
    if not re.fullmatch('[0-9]{1,2}', count) or int(count) != len(flags):
        raise ProtocolError(f'not a list of warnings: {data[:60]!r}')
    if not all(re.fullmatch('[A-Z]{2}', flag) for flag in flags):
        raise ProtocolError(f'not a list of warnings: {data[:60]!r}')
    return tuple(flags)
