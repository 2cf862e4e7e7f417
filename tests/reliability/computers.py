"""Two network namespaces as two computers, joined by a cable that delays, loses and is cut."""

from __future__ import annotations

import fcntl
import os
import struct
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from stage_bringup.processes import NodeCommand

#: ioctl and flags of Linux' tun.h: an Ethernet device whose frames a process reads and writes.
TUNSETIFF, IFF_TAP, IFF_NO_PI = 0x400454CA, 0x0002, 0x1000
#: Names are unique on the machine, so that two test runs do not meet.
PREFIX = f'stage{os.getpid() % 100_000}'
NAMES = f'{PREFIX}a', f'{PREFIX}b'
ADDRESSES = '10.77.0.1', '10.77.0.2'


#: A port of the first computer's loopback, where the emulated tracker listens, for the second.
FORWARD = """
import socket, sys, threading
address, port = sys.argv[1], int(sys.argv[2])
def copy(source, sink):
    while data := source.recv(65536):
        sink.sendall(data)
    sink.close()
server = socket.create_server((address, port))
while True:
    outer, _ = server.accept()
    try:
        inner = socket.create_connection(('127.0.0.1', port))
    except OSError:
        outer.close()
        continue
    for ends in ((outer, inner), (inner, outer)):
        threading.Thread(target=copy, args=ends, daemon=True).start()
"""


@dataclass(frozen=True)
class On(NodeCommand):
    """A node on one of the computers."""

    computer: str = ''

    def arguments(self) -> list[str]:
        """Command line of the process."""
        return ['ip', 'netns', 'exec', self.computer, *super().arguments()]


def ip(*words: str) -> None:
    """Run `ip`; raises CalledProcessError."""
    subprocess.run(['ip', *words], check=True, capture_output=True)


def _computer(name: str, address: str) -> int:
    """A namespace with one Ethernet device; the descriptor of the device's other end."""
    device = os.open('/dev/net/tun', os.O_RDWR)
    tap = f'{name}0'
    fcntl.ioctl(device, TUNSETIFF, struct.pack('16sH', tap.encode(), IFF_TAP | IFF_NO_PI))
    ip('netns', 'add', name)
    ip('link', 'set', tap, 'netns', name)
    ip('-n', name, 'address', 'add', f'{address}/24', 'dev', tap)
    for interface in ('lo', tap):
        ip('-n', name, 'link', 'set', interface, 'up')
    ip('-n', name, 'route', 'add', 'default', 'dev', tap)
    return device


class Cable:
    """The process that carries the frames between two computers."""

    def __init__(self, ends: list[int], delay: float, loss: float) -> None:
        script = Path(__file__).with_name('cable.py')
        self._process = subprocess.Popen(
            [sys.executable, str(script), *map(str, ends), str(delay), str(loss)],
            stdin=subprocess.PIPE, pass_fds=ends,
        )  # fmt: skip

    def _tell(self, word: bytes) -> None:
        assert self._process.stdin is not None
        self._process.stdin.write(word + b'\n')
        self._process.stdin.flush()

    def cut(self) -> None:
        """Carry nothing more."""
        self._tell(b'cut')

    def join(self) -> None:
        """Carry again."""
        self._tell(b'join')

    def end(self) -> None:
        """End the process."""
        self._process.kill()
        self._process.communicate()


#: Listens for one multicast datagram, the way in which nodes find each other.
LISTEN = """
import socket, struct
s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
s.bind(('', 7411))
group = socket.inet_aton('239.255.0.1') + socket.inet_aton('{address}')
s.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, group)
s.settimeout(20)
s.recv(10)
"""
#: Sends it, again and again, for the cable loses some.
SEND = """
import socket, time
s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
s.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton('{address}'))
while True:
    s.sendto(b'here', ('239.255.0.1', 7411))
    time.sleep(0.1)
"""


def _within(computer: str, script: str) -> subprocess.Popen[bytes]:
    """Python on one of the computers."""
    return subprocess.Popen(
        ['ip', 'netns', 'exec', computer, sys.executable, '-c', script], stderr=subprocess.DEVNULL
    )


def _multicast_passes(sender: int, receiver: int) -> bool:
    """Whether a multicast datagram of one computer reaches the other within 20 s."""
    listening = _within(NAMES[receiver], LISTEN.format(address=ADDRESSES[receiver]))
    sending = _within(NAMES[sender], SEND.format(address=ADDRESSES[sender]))
    try:
        return listening.wait() == 0
    finally:
        sending.kill()
        sending.wait()


@contextmanager
def two_computers(delay: float, loss: float) -> Iterator[Cable]:
    """Computers `NAMES` and their cable, which delays by `delay` [s] and loses a share `loss`.

    Raises
    ------
    OSError, subprocess.CalledProcessError
        Namespaces or Ethernet devices are not permitted here, or no multicast passes between two.
    """
    ends: list[int] = []
    cable = None
    try:
        for name, address in zip(NAMES, ADDRESSES, strict=True):
            ends.append(_computer(name, address))
        cable = Cable(ends, delay, loss)
        if not (_multicast_passes(0, 1) and _multicast_passes(1, 0)):
            raise OSError('no multicast passes between two namespaces')
        yield cable
    finally:
        if cable is not None:
            cable.end()
        for end in ends:
            os.close(end)
        for name in NAMES[: len(ends)]:
            subprocess.run(['ip', 'netns', 'delete', name], capture_output=True, check=False)


@contextmanager
def forwarded(port: int) -> Iterator[None]:
    """The first computer's own port at its address on the cable."""
    script = [sys.executable, '-c', FORWARD, ADDRESSES[0], str(port)]
    process = subprocess.Popen(['ip', 'netns', 'exec', NAMES[0], *script])
    try:
        yield
    finally:
        process.kill()
        process.wait()
