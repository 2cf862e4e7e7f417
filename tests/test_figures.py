"""The figures that the docs print come from their commands: the cheap ones are compared here.

Expensive figures carry their commit and date on the page instead.
"""

from __future__ import annotations

import contextlib
import re
import runpy
import sys
from pathlib import Path

import pytest

DOCS = Path(__file__).resolve().parents[1] / 'docs'
NUMBER = re.compile(r'(?<![\w.])[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?')
#: How long a step took, on the machine that wrote the page.
SECONDS = re.compile(r'\d+\.\d+ s\b')
#: Below this only the rounding of the processor is left, in m, µm and kelvin alike.
ROUNDING = 1e-8


def parts(line: str) -> tuple[list[str], list[float]]:
    """Words and numbers of a line."""
    line = SECONDS.sub('', line)
    return NUMBER.sub('#', line).split(), [float(n) for n in NUMBER.findall(line)]


def alike(line: str, other: str) -> bool:
    """Whether two lines say the same, to a hundredth of each number."""
    (words, numbers), (others, theirs) = parts(line), parts(other)
    return words == others and numbers == pytest.approx(theirs, rel=0.01, abs=ROUNDING)


def missing(printed: str, page: str) -> list[str]:
    """Lines with a number that the page does not have."""
    lines = page.splitlines()
    return [
        line
        for line in printed.splitlines()
        if NUMBER.search(line) and not any(alike(line, other) for other in lines)
    ]


def test_a_figure_of_another_state_is_seen() -> None:
    page = 'held-out RMS 0.703 µm (15 t 0.10 s)\nround-off 1.7e-16'
    assert missing('held-out RMS 0.704 µm (15 t 0.55 s)\nround-off 2.9e-17', page) == []
    assert missing('held-out RMS 0.753 µm (15 t 0.10 s)', page) != []
    assert missing('held-out MAE 0.703 µm (15 t 0.10 s)', page) != []


@pytest.mark.parametrize(
    ('page', 'command'),
    [
        ('results/hra.md', '-m hra_curves table3'),
        ('results/hra.md', '-m hra_curves table4'),
        ('results/calibration.md', 'benchmarks/paper5_examples.py'),
        ('results/calibration.md', 'benchmarks/paper2_figure11.py'),
        ('results/contour.md', 'benchmarks/contour_estimators.py'),
    ],
)
def test_the_page_holds_what_the_command_prints(
    page: str, command: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    text = (DOCS / page).read_text(encoding='utf-8')
    assert f'python {command}' in text
    first, *arguments = command.split()
    module = arguments.pop(0) if first == '-m' else ''
    monkeypatch.setattr(sys, 'argv', [first, *arguments])
    run = runpy.run_module if module else runpy.run_path
    with contextlib.suppress(SystemExit):
        run(module or str(DOCS.parent / first), run_name='__main__')
    printed = capsys.readouterr().out
    assert NUMBER.search(printed)
    assert missing(printed, text) == []
