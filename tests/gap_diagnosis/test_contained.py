"""What an asymmetric friction is made of stands in the report, beside the one name."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from gap_diagnosis.diagnose import diagnose
from gap_diagnosis.report import document as report
from gap_diagnosis.report import page
from stage_core.session import Session

from .conftest import nominal

Maker = Callable[..., Session]

ASYMMETRIC = {
    'coulomb_positive': 9.0,
    'coulomb_negative': 5.0,
    'viscous_positive': 30.0,
    'viscous_negative': 70.0,
    'presliding': 5e-6,
}


def test_the_parts_of_an_asymmetric_friction(planted: Maker, tmp_path: Path) -> None:
    found = diagnose([planted({'asymmetric_friction.x': ASYMMETRIC})], [], nominal())
    assert found.verdict == ['asymmetric_friction.x']
    cause = json.loads(report.write(found, tmp_path).read_text())['causes'][0]
    parts = {part['part']: part for part in cause['contains']}
    names = ['viscous_friction.x', 'coulomb_friction.x', 'force_offset.x']
    assert list(parts)[:5] == [*names, 'asymmetric_friction.x', 'presliding']
    for name in [*names, 'asymmetric_friction.x']:
        assert parts[name]['supported']
        low, high = parts[name]['shrink_ci95']
        assert 0.0 < low <= parts[name]['shrink'] <= high < 1.0
    viscous = parts['viscous_friction.x']['parameters']['viscous']
    assert viscous['value'] == pytest.approx(50.0, rel=0.2) and viscous['unit'] == 'N·s/m'
    coulomb = parts['coulomb_friction.x']['parameters']['coulomb']
    assert coulomb['value'] == pytest.approx(7.0, rel=0.1) and coulomb['std'] > 0.0
    # The friction was planted without a Stribeck part.
    falling = parts.get('stribeck_friction.x')
    assert falling is None or falling['shrink'] < 0.05
    text = page.render(found)
    assert 'What asymmetric friction of x contains' in text
    assert 'friction differs between the directions' in text
