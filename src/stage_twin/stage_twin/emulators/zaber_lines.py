"""The device's side of Zaber ASCII lines: commands in, answers out.

Written apart from the driver's codec, so that one checks the other in the tests.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

PACKET_SIZE = 80
LONGEST_COMMAND = 1024
SILENT = '--'

#: Priority of the warning flags, highest first (interfaces_zaber.md, "Warning flags").
FLAG_ORDER: tuple[str, ...] = (
    *('FF', 'FN', 'FZ', 'FH', 'FV', 'FO', 'FD', 'FC', 'FM', 'FQ', 'FI', 'FS', 'FB', 'FP', 'FE'),
    *('FR', 'FT', 'WL', 'WH', 'WR', 'WP', 'WV', 'WT', 'WS', 'WM'),
    *('NC', 'NI', 'ND', 'NR', 'NT', 'NU', 'NJ', 'NB'),
)


@dataclass(frozen=True)
class Request:
    """A parsed command; `message_id` is two digits, `--` for silence, or empty for none."""

    device: int
    axis: int
    message_id: str
    words: tuple[str, ...]
    continued: int = 0
    unfinished: bool = False

    @property
    def id_is_valid(self) -> bool:
        """Whether the id is absent, `--`, or 0..99."""
        if self.message_id in ('', SILENT):
            return True
        return int(self.message_id) <= 99

    def extended(self, continuation: Request) -> Request:
        """This unfinished command with the words of its continuation."""
        return replace(
            self,
            words=(*self.words, *continuation.words),
            unfinished=continuation.unfinished,
        )


def lrc(body: bytes) -> int:
    """Checksum of the bytes between start character and colon: sum + checksum = 0 mod 256."""
    return (256 - sum(body) % 256) % 256


def parse_request(line: bytes) -> Request | None:
    """Command of a line without its end; None for what a device drops in silence."""
    start = line.find(b'/')
    if start < 0 or any(byte < 32 or byte > 126 for byte in line):
        return None
    body = line[start + 1 :]
    if len(body) >= 3 and body[-3:-2] == b':':
        try:
            wanted = int(body[-2:], 16)
        except ValueError:
            return None
        body = body[:-3]
        if lrc(body) != wanted:
            return None
    if b':' in body:
        return None
    unfinished = body.endswith(b'\\')
    words = body.rstrip(b'\\').decode('ascii').split()
    numbers: list[str] = []
    while words and len(numbers) < 3 and (words[0].isdigit() or words[0] == SILENT):
        numbers.append(words.pop(0))
    if SILENT in numbers[:2]:
        return None
    device, axis, message_id = [*numbers, *['0', '0', ''][len(numbers) :]]
    if len(device) > 4 or len(axis) > 4 or len(message_id) > 9:
        return None
    continued = 0
    if len(words) >= 2 and words[0] == 'cont' and words[1].isdigit() and len(words[1]) < 3:
        continued = int(words[1])
        words = words[2:]
    return Request(int(device), int(axis), message_id, tuple(words), continued, unfinished)


def format_answer(
    kind: str, device: int, axis: int, message_id: str, text: str, checksums: bool
) -> list[bytes]:
    """Lines of a reply (`@`) or alert (`!`), continued with `#... cont` where it is too long."""
    head = f'{device:02d} {axis}' + (f' {int(message_id):02d}' if message_id else '')
    longest = PACKET_SIZE - len('@\\:CC\r\n')
    bodies: list[str] = []
    body = head
    first = True
    for word in text.split(' '):
        if not first and len(body) + 1 + len(word) > longest:
            bodies.append(body + '\\')
            body = f'{head} cont'
        body = f'{body} {word}'
        first = False
    bodies.append(body)
    lines = []
    for number, content in enumerate(bodies):
        raw = content.encode('ascii')
        seal = b':%02X' % lrc(raw) if checksums else b''
        lines.append((kind if number == 0 else '#').encode() + raw + seal + b'\r\n')
    return lines


@dataclass
class CommandBuffer:
    """Bytes of the line so far; backspace erases, DEL discards, an overlong line is dropped."""

    pending: bytearray = field(default_factory=bytearray)
    spoiled: bool = False

    def feed(self, data: bytes) -> list[bytes]:
        """Complete non-empty lines."""
        lines = []
        for byte in data:
            if byte in (10, 13):
                if self.pending and not self.spoiled:
                    lines.append(bytes(self.pending))
                self.pending.clear()
                self.spoiled = False
            elif byte == 8:
                del self.pending[-1:]
            elif byte == 127:
                self.pending.clear()
                self.spoiled = False
            elif len(self.pending) >= LONGEST_COMMAND:
                self.spoiled = True
            else:
                self.pending.append(byte)
        return lines
