"""Noise on every wire: nothing but the parser's own error escapes, and nothing piles up.

A million frames: `benchmarks/fuzz_parsers.py`.
"""

from __future__ import annotations

import tracemalloc

import pytest

from .fuzz import PARSERS, frames


@pytest.mark.parametrize('name', PARSERS)
def test_noise_raises_nothing_and_leaves_nothing_behind(name: str) -> None:
    parse, good = PARSERS[name]()
    understood = sum(parse(frame) for frame in frames(good, 1500, seed=1))
    assert understood > 50, 'most frames are noise to this parser: the test judges nothing'
    tracemalloc.start()
    try:
        before = tracemalloc.get_traced_memory()[0]
        for frame in frames(good, 1500, seed=2):
            parse(frame)
        grown = tracemalloc.get_traced_memory()[0] - before
    finally:
        tracemalloc.stop()
    assert grown < 200_000
