"""report.json to the letter of docs/reference/interfaces_report.md."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pytest

from gap_diagnosis.report import document as report
from gap_diagnosis.result import Diagnosis
from stage_core.quantities import LINKS, split_effect
from stage_twin.effects import EFFECTS, link_of

CONDITIONS = {
    'reversal', 'position', 'screw_phase', 'speed', 'acceleration', 'temperature', 'time',
    'frequency_band', 'cross_axis',
}  # fmt: skip


DOCS = Path(__file__).resolve().parents[2] / 'docs'
PAGE = (DOCS / 'reference' / 'interfaces_report.md').read_text('utf-8')


def keys(value: Any) -> set[str]:
    """Every key of a report; what it names itself (channels, axes, parameters) apart."""
    if isinstance(value, list):
        return set().union(*map(keys, value))
    if not isinstance(value, dict):
        return set()
    own = {'channels', 'axes', 'parameters'}
    inner = [v.values() if k in own else [v] for k, v in value.items()]
    return set(value) | set().union(*(keys(v) for values in inner for v in values))


def check_report(result: Diagnosis, directory: Path, expected: Iterable[str]) -> None:
    """Write a report of one axis and check every field."""
    path = report.write(result, directory)
    assert path == directory / 'report.json'
    found: dict[str, Any] = json.loads(path.read_text(encoding='utf-8'))
    assert found['schema'] == 'gap-report/1'
    assert isinstance(found['session'], str) and isinstance(found['twin'], str)
    _gap(found['gap'])
    where = found['where']
    assert where['link'] in LINKS
    assert set(where['axes']) == {'x'}
    for condition in where['conditions']:
        assert condition['name'] in CONDITIONS and condition['axis'] == 'x'
        assert 0.0 <= condition['share'] <= 1.0 and 0.0 <= condition['p_value'] <= 1.0
    causes = found['causes']
    for cause in causes:
        _cause(cause)
    names = [c['effect'] for c in causes]
    assert len(set(names)) == len(names) and {'unknown', 'none'} <= set(names)
    # The accepted ones first, the rest by probability.
    accepted = [c['effect'] for c in causes if c['status'] == 'accepted']
    named = [n for n in accepted if n != 'none']
    assert names[: len(named)] == named == found['verdict']
    assert set(found['verdict']) == set(expected)
    if found['verdict']:
        assert where['link'] == link_of(named[0])
    rest = [c['probability'] for c in causes[len(accepted) :]]
    assert rest == sorted(rest, reverse=True)
    if len(found['verdict']) <= 1:
        assert sum(c['probability'] for c in causes) == pytest.approx(1.0)
    assert 0.0 <= found['unexplained']['share'] <= 1.0
    assert isinstance(found['unexplained']['structured'], bool)
    assert keys(found) <= set(re.findall(r'"([\w.]+)":', PAGE)) | {'contains', 'part', 'supported'}


def _gap(gap: dict[str, Any]) -> None:
    assert gap['unit'] == 'm' and gap['metric'] == 'rms'
    assert all(stop > start for start, stop in gap['heldout_windows'])
    # Forces have channels of their own, in N; the gap counts positions.
    channels = {n: c for n, c in gap['channels'].items() if c['unit'] == 'm'}
    assert set(channels) == {'encoder.x', 'tracker.x'}
    for which in ('before', 'after'):
        mean = sum(c[which] ** 2 for c in channels.values()) / len(channels)
        assert gap[which] == pytest.approx(mean**0.5)
    assert gap['shrink'] == pytest.approx(1.0 - gap['after'] / gap['before'])
    assert 0.0 < gap['noise_floor'] < 1e-5


def _cause(cause: dict[str, Any]) -> None:
    effect = cause['effect']
    assert split_effect(effect)[0] in {*EFFECTS, 'unknown', 'none'}
    assert 0.0 <= cause['probability'] <= 1.0
    assert cause['status'] in ('accepted', 'rejected', 'below_noise')
    assert isinstance(cause['alternatives'], list)
    assert len(cause['shrink_ci95']) == 2
    assert cause['shrink'] == pytest.approx(1.0 - cause['gap_after'] / cause['gap_before'])
    for parameter in cause['parameters'].values():
        assert set(parameter) == {'value', 'std', 'unit'}
    if cause['status'] == 'accepted' and effect not in ('unknown', 'none'):
        assert cause['parameters'] and cause['gap_after'] <= cause['gap_before']
