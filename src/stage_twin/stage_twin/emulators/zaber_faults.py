"""Faults of the line between a Zaber chain and its host, injected reply by reply."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

from stage_core.errors import StageError

KINDS = ('drop', 'duplicate', 'truncate', 'corrupt', 'garbage', 'wrong_device', 'delay')
GARBAGE = b'\x00\xff~@#9 OK:\xc3\x28 1\r\n'


@dataclass
class LineFaults:
    """Applies the injected faults to the next replies, oldest fault first."""

    delay: float = 0.5
    """How late a delayed reply comes [s]."""
    applied: int = 0
    _waiting: deque[str] = field(default_factory=deque)
    _late: list[tuple[float, bytes]] = field(default_factory=list)

    def inject(self, kind: str, count: int = 1) -> None:
        """Let the next `count` replies suffer `kind`.

        Raises
        ------
        StageError
            If there is no such fault.
        """
        if kind not in KINDS:
            raise StageError(f'no line fault {kind!r}: take one of {", ".join(KINDS)}')
        self._waiting.extend([kind] * count)

    def pass_on(self, lines: list[bytes], time: float) -> bytes:
        """Bytes that reach the host at `time` [s] of these lines and of earlier late ones."""
        sent = b''
        for line in lines:
            if line.startswith(b'@') and self._waiting:
                self.applied += 1
                sent += self._suffer(self._waiting.popleft(), line, time)
            else:
                sent += line
        due = [line for when, line in self._late if when <= time]
        self._late = [(when, line) for when, line in self._late if when > time]
        return sent + b''.join(due)

    def _suffer(self, kind: str, line: bytes, time: float) -> bytes:
        if kind == 'drop':
            return b''
        if kind == 'duplicate':
            return line + line
        if kind == 'truncate':
            return line[: len(line) // 2] + b'\r\n'
        if kind == 'corrupt':
            middle = len(line) // 2
            return line[:middle] + bytes([line[middle] ^ 0x15 | 0x80]) + line[middle + 1 :]
        if kind == 'garbage':
            return GARBAGE + line
        if kind == 'wrong_device':
            return b'@77' + line[3:]
        self._late.append((time + self.delay, line))
        return b''
