"""One emulated Zaber device: its settings and its command table."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from stage_twin.emulators.zaber_axis import Rejection, ZaberAxis, highest
from stage_twin.emulators.zaber_lines import FLAG_ORDER, SILENT, Request, format_answer

#: Settings of a device that a host may change, with their largest value.
WRITABLE = {
    'comm.alert': 1,
    'comm.checksum': 1,
    'knob.enable': 1,
    'system.access': 2,
    'comm.address': 99,
}


class ZaberDevice:
    """A device with its axes; answers requests that the chain hands to it."""

    def __init__(self, address: int, axes: Sequence[ZaberAxis], serial: int) -> None:
        self.axes = list(axes)
        self.values: dict[str, float | str] = {
            'deviceid': 50081,
            'device.id': 50081,
            'device.hw.modified': 0,
            'system.serial': serial,
            'system.axiscount': len(self.axes),
            'system.access': 1,
            'system.voltage': '48.0',
            'system.temperature': '32.0',
            'version': '7.38',
            'version.build': 1234,
            'comm.address': address,
            'comm.alert': 0,
            'comm.checksum': 0,
            'comm.protocol': 2,
            'comm.rs232.baud': 115200,
            'comm.packet.size.max': 80,
            'comm.word.size.max': 50,
            'comm.command.packets.max': 10,
            'get.settings.max': 10,
            'knob.enable': 1,
        }
        self._partial: Request | None = None
        self._commands: dict[str, Callable[[int, list[str]], str]] = {
            'get': self._get,
            'set': self._set,
            'home': self._home,
            'move': self._move,
            'stop': self._stop,
            'estop': self._estop,
            'warnings': self._warnings,
            'tools': self._tools,
            'driver': self._driver,
            'system': self._system,
            'storage': self._storage,
        }

    @property
    def address(self) -> int:
        """Address in the chain."""
        return int(self.values['comm.address'])

    @property
    def checksums(self) -> bool:
        """Whether answers carry a checksum."""
        return bool(self.values['comm.checksum'])

    def power_cycle(self) -> None:
        """Restart: settings stay, positions are lost."""
        self._partial = None
        for axis in self.axes:
            axis.power_cycle()

    def alerts(self) -> list[bytes]:
        """Lines for the movements that ended since the last call."""
        lines: list[bytes] = []
        for number, axis in enumerate(self.axes, 1):
            if axis.update() and self.values['comm.alert']:
                text = f'IDLE {axis.flag}'
                lines += format_answer('!', self.address, number, '', text, self.checksums)
        return lines

    def answer(self, request: Request) -> list[bytes]:
        """Lines that answer a request addressed to this device; empty for silence."""
        whole = self._join(request)
        if whole is None:
            return []
        known_axis = whole.axis if whole.axis <= len(self.axes) else 0
        if not whole.id_is_valid:
            whole = replace(whole, message_id='', axis=known_axis)
            return self._reply(whole, False, 'BADMESSAGEID')
        if known_axis != whole.axis:
            return self._reply(replace(whole, axis=0), False, 'BADAXIS')
        try:
            data = self._execute(whole)
        except Rejection as reason:
            return self._reply(whole, False, str(reason))
        return self._reply(whole, True, data)

    def renumber(self, address: int, request: Request) -> list[bytes]:
        """Take a new address and answer with it."""
        self.values['comm.address'] = address
        return self._reply(request, True, '0')

    def _join(self, request: Request) -> Request | None:
        """Join continuation packets; None while a command is incomplete or out of order."""
        if request.continued:
            before = self._partial
            if before is None or before.message_id != request.message_id:
                return None
            request = before.extended(request)
        self._partial = None
        if request.unfinished:
            self._partial = request
            return None
        return request

    def _execute(self, request: Request) -> str:
        if not request.words:
            return '0'
        handler = self._commands.get(request.words[0])
        if handler is None:
            raise Rejection('BADCOMMAND')
        return handler(request.axis, list(request.words[1:]))

    def _reply(self, request: Request, accepted: bool, data: str) -> list[bytes]:
        if request.message_id == SILENT:
            return []
        chosen = self._chosen(request.axis)
        busy = any(axis.busy for axis in chosen)
        flag = highest(set().union(*(axis.flags for axis in chosen)))
        text = f'{"OK" if accepted else "RJ"} {"BUSY" if busy else "IDLE"} {flag} {data}'
        return format_answer(
            '@', self.address, request.axis, request.message_id, text, self.checksums
        )

    def _chosen(self, axis: int) -> list[ZaberAxis]:
        return self.axes if axis == 0 else [self.axes[axis - 1]]

    # -- commands -----------------------------------------------------------------------------

    def _get(self, axis: int, words: list[str]) -> str:
        if len(words) != 1:
            raise Rejection('BADCOMMAND')
        name = words[0]
        if name in self.values:
            if axis:
                raise Rejection('DEVICEONLY')
            return str(self.values[name])
        return ' '.join(chosen.get(name) for chosen in self._chosen(axis))

    def _set(self, axis: int, words: list[str]) -> str:
        if len(words) != 2:
            raise Rejection('BADCOMMAND')
        name, text = words
        if name not in self.values:
            for chosen in self._chosen(axis):
                chosen.set(name, text)
            return '0'
        if axis:
            raise Rejection('DEVICEONLY')
        if name not in WRITABLE:
            raise Rejection('NOACCESS')
        lowest = 1 if name in ('comm.address', 'system.access') else 0
        if not text.isdigit() or not lowest <= int(text) <= WRITABLE[name]:
            raise Rejection('BADDATA')
        self.values[name] = int(text)
        return '0'

    def _home(self, axis: int, words: list[str]) -> str:
        if words:
            raise Rejection('BADCOMMAND')
        for chosen in self._chosen(axis):
            chosen.home()
        return '0'

    def _move(self, axis: int, words: list[str]) -> str:
        if not words:
            raise Rejection('BADCOMMAND')
        kind, *texts = words
        numbers = [_number(text) for text in texts]
        for chosen in self._chosen(axis):
            if kind in ('abs', 'rel') and 1 <= len(numbers) <= 3:
                start = chosen.position if kind == 'rel' else 0
                if numbers[0] != int(numbers[0]):
                    raise Rejection('BADDATA')
                chosen.move(start + int(numbers[0]), *numbers[1:])
            elif kind == 'vel' and 1 <= len(numbers) <= 2:
                chosen.move_velocity(*numbers)
            elif kind in ('min', 'max') and len(numbers) <= 2:
                chosen.move(int(chosen.values[f'limit.{kind}']), *numbers)
            else:
                raise Rejection('BADCOMMAND')
        return '0'

    def _stop(self, axis: int, words: list[str]) -> str:
        for chosen in self._chosen(axis):
            chosen.stop()
        return '0'

    def _estop(self, axis: int, words: list[str]) -> str:
        for chosen in self._chosen(axis):
            chosen.stop(at_once=True)
        return '0'

    def _warnings(self, axis: int, words: list[str]) -> str:
        chosen = self._chosen(axis)
        flags = set().union(*(each.flags for each in chosen))
        shown = [flag for flag in FLAG_ORDER if flag in flags]
        if words == ['clear']:
            for each in chosen:
                each.clear_warnings()
        elif words:
            raise Rejection('BADCOMMAND')
        return ' '.join([f'{len(shown):02d}', *shown])

    def _tools(self, axis: int, words: list[str]) -> str:
        if words[:1] == ['echo']:
            return ' '.join(words[1:]) or '0'
        if words in (['parking', 'park'], ['parking', 'unpark']):
            for chosen in self._chosen(axis):
                if chosen.busy:
                    raise Rejection('STATUSBUSY')
                chosen.values['parking.state'] = float(words[1] == 'park')
            return '0'
        raise Rejection('BADCOMMAND')

    def _driver(self, axis: int, words: list[str]) -> str:
        for chosen in self._chosen(axis):
            if words == ['enable']:
                chosen.flags -= {'FO', 'FD', 'FH', 'FV'}
            elif words == ['disable']:
                chosen.raise_flag('FO')
            else:
                raise Rejection('BADCOMMAND')
        return '0'

    def _system(self, axis: int, words: list[str]) -> str:
        if axis:
            raise Rejection('DEVICEONLY')
        if words != ['reset']:
            raise Rejection('BADCOMMAND')
        self.power_cycle()
        return '0'

    def _storage(self, axis: int, words: list[str]) -> str:
        raise Rejection('BADDATA')


def _number(text: str) -> float:
    """A decimal number of a command; Rejection BADDATA for anything else."""
    digits = text.removeprefix('-')
    if not digits.replace('.', '', 1).isdigit() or len(digits) > 16:
        raise Rejection('BADDATA')
    return float(text)
