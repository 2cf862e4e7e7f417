"""Noise on every wire: nothing but the parser's own error escapes, and nothing piles up.

A million frames: `benchmarks/fuzz_parsers.py`.
"""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from calibrator import model_file
from calibrator.node import _options
from contour_ctrl import curve_file, storage
from session_bags.bag import open_bag
from stage_core.errors import StageError
from stage_core.twin_file import TwinFile

from .fuzz import PARSERS, frames

FILES: dict[str, Callable[[Path], Any]] = {
    'twin file': TwinFile.load,
    'model file': model_file.load,
    'options of a method': lambda path: _options(path.read_text()),
    'curve': lambda path: curve_file.from_text('nurbs', path.read_text(), 'the curve'),
    'learned signals': lambda path: storage.load(path, '', ''),
    'bag': lambda path: open_bag(path.rename(path.with_name('metadata.yaml')).parent),
}

#: Deeper than the interpreter's stack, than the machine's; what a YAML constructor stumbles over.
HOSTILE = (
    *(token * 3000 for token in ('[', '{"a":', '- ')),
    *(token * 200_000 for token in ('[', '{"a":', '- ')),
    *(f'kind: {value}' for value in ('!!int ""', '!!timestamp x', '!!bool x', '2020-13-45')),
    '{"degree": ' + '1' * 5000 + '}',
)


@pytest.mark.parametrize('text', HOSTILE, ids=lambda text: f'{text[:18]}({len(text)})')
@pytest.mark.parametrize('kind', FILES)
def test_text_that_makes_a_parser_fail_is_refused(tmp_path: Path, kind: str, text: str) -> None:
    path = tmp_path / 'deep'
    path.write_text(text)
    with pytest.raises(StageError):
        FILES[kind](path)


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
