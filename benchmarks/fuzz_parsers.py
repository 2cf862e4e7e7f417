"""A million random and damaged frames for the parsers of every wire.

    nice -n 10 .venv/bin/python benchmarks/fuzz_parsers.py --frames 1000000

An exception that a parser does not promise ends the run with its traceback and the frame. Prints
per parser how many frames it understood and how its process grew after the first tenth.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / 'tests' / 'reliability'))

from fuzz import PARSERS, frames


def resident() -> float:
    """Resident memory of this process [MiB]."""
    for line in Path('/proc/self/status').read_text().splitlines():
        if line.startswith('VmRSS'):
            return int(line.split()[1]) / 1024
    raise RuntimeError('no VmRSS in /proc/self/status')


def main() -> int:
    """Feed every parser its share."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--frames', type=int, default=1_000_000)
    parser.add_argument('--seed', type=int, default=1)
    given = parser.parse_args()
    share = -(-given.frames // len(PARSERS))
    print(f'{"parser":18s} {"frames":>9s} {"understood":>11s} {"growth":>11s} {"time":>8s}')
    for name, make in PARSERS.items():
        parse, good = make()
        understood, before, begin = 0, 0.0, time.monotonic()
        for number, frame in enumerate(frames(good, share, given.seed)):
            if number == share // 10:
                before = resident()
            try:
                understood += parse(frame)
            except Exception:
                print(f'{name}: frame {number} of seed {given.seed}: {frame!r}', file=sys.stderr)
                raise
        grown, took = resident() - before, time.monotonic() - begin
        print(f'{name:18s} {share:9d} {understood:11d} {grown:7.2f} MiB {took:6.0f} s', flush=True)
    return 0


if __name__ == '__main__':
    sys.exit(main())
