"""Reading speed of the session reader, beside rosbags and mcap-ros2-support in the same run.

Run: .venv/bin/python benchmarks/bench_reader.py [--minutes 2] [--hour]
"""

from __future__ import annotations

import argparse
import functools
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader

from session_bags.bulk import session_blocks
from session_bags.reader import read_session
from session_bags.writer import SessionWriter
from stage_core import topics
from stage_core.session import Series, Session, by_topic

#: The other two readers get the first part of the session only; their rate does not depend on it.
PEER_SECONDS = 10.0


def session(seconds: float, start: float = 0.0) -> Session:
    """A two-axis session: four joint topics at 1 kHz, tracker at 100 Hz, two temperatures."""
    rng = np.random.default_rng(1)
    first = 1_700_000_000_000_000_000 + round(start * 1e9)
    stamps = first + np.arange(int(seconds * 1000)) * 1_000_000

    def walks(*quantities: str) -> dict[str, np.ndarray]:
        return {q: np.cumsum(rng.normal(size=(len(stamps), 2)), axis=0) * 1e-6 for q in quantities}

    per_axis, slow = Series.per_axis, stamps[::10]
    series = by_topic(
        per_axis(topics.SETPOINT, stamps, **walks('position', 'velocity')),
        per_axis(topics.REFERENCE, stamps, **walks('position', 'velocity')),
        per_axis(topics.JOINT_STATES, stamps, **walks('position', 'velocity')),
        per_axis(topics.COMMAND, stamps, **walks('velocity', 'effort')),
        Series.points(topics.TRACKER_POINT, slow, rng.normal(size=(len(slow), 3))),
    )
    for sensor in ('screw_x', 'screw_y'):
        stamps_here = stamps[::1000]
        series[topics.temperature_key(sensor)] = Series(
            topics.TEMPERATURE, stamps_here, {'temperature': np.full(len(stamps_here), 20.0)}
        )
    return Session('bench', series)


def cpu_seconds(work: Callable[[], int]) -> tuple[int, float]:
    """Messages and CPU time of a reading."""
    begin = time.process_time()
    count = work()
    return count, time.process_time() - begin


def with_rosbags(path: Path) -> int:
    """Read and decode with rosbags."""
    with AnyReader([path]) as reader:
        return sum(1 for c, _, raw in reader.messages() if reader.deserialize(raw, c.msgtype))


def with_mcap_ros2(path: Path) -> int:
    """Read and decode with mcap-ros2-support."""
    with open(next(path.glob('*.mcap')), 'rb') as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        return sum(1 for _ in reader.iter_decoded_messages())


def with_session_bags(path: Path) -> int:
    """Read with the session reader."""
    return sum(len(series) for series in read_session(path).series.values())


def write(path: Path, content: Session, chunk_bytes: int) -> float:
    """Write a session; seconds of CPU time."""
    begin = time.process_time()
    with SessionWriter(path) as writer:
        writer.write_blocks(session_blocks(content), chunk_bytes)
    return time.process_time() - begin


def read_an_hour(folder: Path) -> None:
    """Read a one-hour session in a process of its own, for its peak memory."""
    path = folder / 'hour'
    with SessionWriter(path) as writer:
        for minute in range(60):
            writer.write_blocks(session_blocks(session(60.0, 60.0 * minute)))
    code = (
        'import sys, time, resource; from session_bags.reader import read_session\n'
        'begin = time.process_time(); found = read_session(sys.argv[1])\n'
        'spent = time.process_time() - begin\n'
        'peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20\n'
        'count = sum(map(len, found.series.values()))\n'
        "print(f'one hour: {count} messages in {spent:.1f} s, peak memory {peak:.2f} GiB')"
    )
    subprocess.run([sys.executable, '-c', code, str(path)], check=True)


def main() -> None:
    """Print one line per reader."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--minutes', type=float, default=2.0)
    parser.add_argument('--hour', action='store_true', help='also read a one-hour session')
    arguments = parser.parse_args()
    minutes = arguments.minutes
    with tempfile.TemporaryDirectory() as folder:
        for chunk_bytes, what in ((1 << 20, '1 MiB chunks'), (256 << 10, '256 KiB chunks')):
            path, short = Path(folder) / f'long{chunk_bytes}', Path(folder) / f'short{chunk_bytes}'
            written = write(path, session(60 * minutes), chunk_bytes)
            write(short, session(PEER_SECONDS), chunk_bytes)
            count, seconds = cpu_seconds(functools.partial(with_session_bags, path))
            mine = count / seconds
            print(f'{what}, zstd: {count} messages; CPU time of one core')
            print(f'  written from arrays  {count / written:12,.0f} messages/s')
            print(f'  session_bags         {mine:12,.0f} messages/s')
            for name, reader in (('rosbags', with_rosbags), ('mcap-ros2-support', with_mcap_ros2)):
                count, seconds = cpu_seconds(functools.partial(reader, short))
                rate = count / seconds
                print(f'  {name:<20} {rate:12,.0f} messages/s   {mine / rate:6.1f} times slower')
            begin = time.process_time()
            part = read_session(path, start=30 * minutes, stop=30 * minutes + 1.0)
            spent = time.process_time() - begin
            count = sum(len(series) for series in part.series.values())
            print(f'  one second of it     {spent * 1e3:12.1f} ms for {count} messages')
        if arguments.hour:
            read_an_hour(Path(folder))
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f'peak memory {peak:.0f} MiB')


if __name__ == '__main__':
    main()
