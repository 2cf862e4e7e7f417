"""The table of the benchmark of experiments counts what it says."""

from __future__ import annotations

from typing import Any

from benchmarks.experiment.machine import draw
from benchmarks.experiment.run import MOVED, table


def said(seed: int, right: bool, rivals: list[str]) -> dict[str, Any]:
    name = draw(seed).effect if right else 'none'
    return {'verdict': [name] if right else [], 'alternatives': {name: rivals}}


def test_a_session_without_a_question_stays_as_it_is_and_a_failed_one_is_no_hit() -> None:
    wrong, rival, alone = (
        said(0, True, []) | {'verdict': ['unknown']},
        said(1, True, ['backlash.x']),
        said(2, True, []),
    )
    answers = dict.fromkeys(MOVED, said(0, True, [])) | {'raster': None}
    rows = [
        {'seed': 0, 'before': wrong, 'after': answers},
        {'seed': 1, 'before': rival, 'after': {}},
        {'seed': 2, 'before': alone, 'after': {}},
    ]
    lines = [line.strip('| ').split(' | ') for line in table(rows).splitlines()]
    assert lines[0] == ['of 3 sessions, 1 with a question', 'before', *MOVED]
    counts = {line[0]: line[1:] for line in lines[2:]}
    assert counts['the right name alone, no rival beside it (3)'] == ['1', '2', '2', '1', '2']
    aside = counts['the right name and no other one, rivals aside (3)']
    assert aside == ['2', '3', '3', '2', '3']
    assert counts[f'the same after `{draw(0).motion}` (1)'] == ['0', '1', '1', '0', '1']
