"""Random and damaged frames for every parser of a wire; what it may raise, what it may keep."""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator

from stage_core import drive_link
from stage_core.errors import StageError
from stage_core.twin_file import StepperAxis, TwinFile
from stage_driver.protocol import Assembler, LineSplitter, ProtocolError, decode_answer
from stage_twin.emulators.zaber import ZaberChain
from stage_twin.stepper import StepperPlant
from tracker_bridge import tpi
from tracker_bridge.sa_text import SaTextDecoder, SaTextError, format_script_line
from tracker_bridge.tpi_packets import TpiError

#: Takes a frame; returns whether it was understood. Only what a parser promises is caught.
Parser = Callable[[bytes], bool]


def zaber_answers() -> tuple[Parser, list[bytes]]:
    """The driver's end of the Zaber wire: lines, answers, continuations."""
    splitter, assembler = LineSplitter(), Assembler()

    def parse(frame: bytes) -> bool:
        understood = False
        for line in splitter.feed(frame):
            try:
                assembler.add(decode_answer(line))
                understood = True
            except ProtocolError:
                continue
        return understood

    return parse, [
        b'@01 1 07 OK BUSY WR 123456:14\r\n',
        b'@01 0 RJ IDLE -- BADDATA\r\n',
        b'@01 0 OK IDLE -- w00 w01\\\r\n#01 0 cont w02 w03\\\r\n',
        b'#01 0 cont w04\r\n',
        b'!02 1 IDLE FS:XX\r\n',
    ]


def zaber_commands() -> tuple[Parser, list[bytes]]:
    """The device's end: the emulated chain of two."""
    plant = StepperPlant(TwinFile(kind='stepper', axes={'x': StepperAxis(), 'y': StepperAxis()}))
    plant.reset([1000, 2000])
    chain = ZaberChain(plant)
    now = 0.0

    def parse(frame: bytes) -> bool:
        nonlocal now
        now += 0.01
        answers = LineSplitter().feed(chain.feed(frame, now))
        for line in answers:
            decode_answer(line)
        return bool(answers)

    return parse, [
        b'/1 1 07 move abs 20000 50000\n',
        b'/get pos\n',
        b'/1 0 10 tools echo w00 w01\\\n/1 0 10 cont 1 w02\n',
        b'/1 warnings clear\n',
        b'/2 1 set limit.max 100000:5F\n',
        b'/renumber 1\n',
    ]


def tracker_stream() -> tuple[Parser, list[bytes]]:
    """The bridge's end of emScon TPI; it connects again after an error."""
    splitter = tpi.StreamSplitter(maximum_size=65536)

    def parse(frame: bytes) -> bool:
        nonlocal splitter
        try:
            return [tpi.decode(packet) for packet in splitter.feed(frame)] != []
        except TpiError:
            splitter = tpi.StreamSplitter(maximum_size=65536)
            return False

    return parse, [
        tpi.encode_answer(49),
        tpi.encode_error(49, 4),
        tpi.encode_status_change(1),
        tpi.HEADER.pack(8 + 28, 7) + bytes(28),
        tpi.HEADER.pack(8 + 100, 3) + bytes(100),
    ]


def tracker_commands() -> tuple[Parser, list[bytes]]:
    """The tracker's end of emScon TPI."""

    def parse(frame: bytes) -> bool:
        try:
            tpi.decode_command(frame)
        except TpiError:
            return False
        return True

    return parse, [tpi.encode_command(49), tpi.encode_command(5, 1, 2, 3)]


def tracker_text() -> tuple[Parser, list[bytes]]:
    """SpatialAnalyzer text over UDP."""
    decoder = SaTextDecoder()

    def parse(frame: bytes) -> bool:
        try:
            decoder.decode(frame, 1)
        except SaTextError:
            return False
        return True

    return parse, [
        format_script_line(7, 1_000_000_000, (0.1, 0.2, 0.3), 'mm', 2),
        b'X: 1.0 Y: 2.0 Z: 3.0 mm',
    ]


def drive_datagrams() -> tuple[Parser, list[bytes]]:
    """Both ends of the drive link."""

    def parse(frame: bytes) -> bool:
        try:
            drive_link.decode(frame)
        except StageError:
            return False
        return True

    return parse, [
        drive_link.encode_hello(),
        drive_link.encode_force(3, 3_000_000, (1.0, -1.0)),
        drive_link.encode_encoder(3, 3_000_000, (1.0, -1.0), (20.0,) * len(drive_link.SENSORS)),
    ]


PARSERS = {
    'Zaber answers': zaber_answers,
    'Zaber commands': zaber_commands,
    'tracker stream': tracker_stream,
    'tracker commands': tracker_commands,
    'tracker text': tracker_text,
    'drive link': drive_datagrams,
}


def frames(good: list[bytes], count: int, seed: int) -> Iterator[bytes]:
    """Frames: noise, and good ones changed, cut, doubled, joined."""
    draw = random.Random(seed)
    for _ in range(count):
        kind = draw.randrange(6)
        if kind == 0:
            yield draw.randbytes(draw.randrange(1, 120))
            continue
        frame = bytearray(draw.choice(good))
        if kind == 1:
            for _ in range(draw.randrange(1, 4)):
                frame[draw.randrange(len(frame))] = draw.randrange(256)
        elif kind == 2:
            del frame[draw.randrange(len(frame)) :]
        elif kind == 3:
            begin = draw.randrange(len(frame))
            frame[begin:begin] = frame[begin : begin + draw.randrange(1, 20)]
        elif kind == 4:
            frame += draw.choice(good)[draw.randrange(4) :]
        yield bytes(frame)
