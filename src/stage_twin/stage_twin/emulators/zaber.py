"""A daisy chain of Zaber ASCII devices as one pure object: bytes in, bytes out, time given.

The devices share the line: a broadcast is answered by every device in the order of the cable.
Motion comes from a plant (`StepperPlant` of the twin, or anything with the same methods).
"""

from __future__ import annotations

from collections.abc import Sequence

from stage_core.errors import StageError
from stage_twin.emulators.zaber_axis import StepperPort, ZaberAxis
from stage_twin.emulators.zaber_device import ZaberDevice
from stage_twin.emulators.zaber_faults import LineFaults
from stage_twin.emulators.zaber_lines import CommandBuffer, Request, parse_request

FIRST_SERIAL = 50001


class ZaberChain:
    """Devices 1, 2, ... on one line, by default one per axis of the plant.

    Parameters
    ----------
    plant
        Moves the motors; axes are counted from 0.
    layout
        Number of axes of each device in cable order.
    """

    def __init__(self, plant: StepperPort, layout: Sequence[int] = (1, 1)) -> None:
        if not layout or min(layout) < 1 or max(layout) > 9:
            raise StageError(f'a Zaber device has 1 to 9 axes, got {list(layout)}')
        self.plant = plant
        self.faults = LineFaults()
        self.devices: list[ZaberDevice] = []
        index = 0
        for number, count in enumerate(layout):
            axes = [ZaberAxis(plant, index + offset) for offset in range(count)]
            self.devices.append(ZaberDevice(number + 1, axes, FIRST_SERIAL + number))
            index += count
        self._buffer = CommandBuffer()
        self.dropped_lines = 0

    @property
    def axes(self) -> list[ZaberAxis]:
        """All axes in cable order."""
        return [axis for device in self.devices for axis in device.axes]

    def feed(self, data: bytes, time: float) -> bytes:
        """Answer what the host has sent, at `time` [s] of the plant."""
        lines: list[bytes | None] = [*self.lines(data)]
        return b''.join(self.poll(time, line) for line in lines or [None])

    def lines(self, data: bytes) -> list[bytes]:
        """Command lines that are complete with `data`."""
        return self._buffer.feed(data)

    def poll(self, time: float, line: bytes | None = None) -> bytes:
        """Answer a line at `time` [s]; alerts of ended moves and late replies come unasked."""
        answers = self._pass_time(time)
        request = None if line is None else parse_request(line)
        if request is not None:
            answers += self._dispatch(request)
        elif line is not None:
            self.dropped_lines += 1
        return self.faults.pass_on(answers, time)

    def power_cycle(self) -> None:
        """Switch the power of the whole chain off and on: every position is lost."""
        self._buffer = CommandBuffer()
        for device in self.devices:
            device.power_cycle()

    def _pass_time(self, time: float) -> list[bytes]:
        self.plant.advance_to(time)
        return [line for device in self.devices for line in device.alerts()]

    def _dispatch(self, request: Request) -> list[bytes]:
        if request.words[:1] == ('renumber',):
            return self._renumber(request)
        addressed = [device for device in self.devices if request.device in (0, device.address)]
        return [line for device in addressed for line in device.answer(request)]

    def _renumber(self, request: Request) -> list[bytes]:
        """Number the chain in cable order, or give one device another address."""
        words = request.words[1:]
        number = 1
        if words:
            if len(words) > 1 or not words[0].isdigit() or not 1 <= int(words[0]) <= 99:
                return []
            number = int(words[0])
        lines: list[bytes] = []
        for device in self.devices:
            if request.device == 0:
                lines += device.renumber(number, request)
                number += 1
            elif device.address == request.device and words:
                lines += device.renumber(number, request)
                break
        return lines
