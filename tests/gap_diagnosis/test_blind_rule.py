"""The blind generator shares no code with the twin or the diagnosis."""

from __future__ import annotations

import ast
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]
FOLDER = ROOT / 'benchmarks' / 'blind'
FORBIDDEN = {'stage_twin', 'gap_diagnosis', 'calibrator', 'contour_ctrl', 'stage_driver'}


def imports(path: Path) -> set[str]:
    """Top-level packages that a module imports, also inside functions."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding='utf-8'))):
        if isinstance(node, ast.Import):
            found |= {alias.name.split('.')[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found.add(node.module.split('.')[0])
        elif isinstance(node, ast.Call) and 'import_module' in ast.dump(node.func):
            found.add('importlib')
    return found


@pytest.mark.parametrize('path', sorted(FOLDER.glob('*.py')), ids=lambda p: p.name)
def test_the_blind_suite_imports_neither_twin_nor_diagnosis(path: Path) -> None:
    assert not imports(path) & (FORBIDDEN | {'importlib'})


def test_the_rule_sees_a_forbidden_import(tmp_path: Path) -> None:
    bad = tmp_path / 'bad.py'
    bad.write_text('def f():\n    from stage_twin.simulate import simulate\n    return simulate\n')
    assert imports(bad) & FORBIDDEN


def test_the_blind_machine_follows_the_servo_controller() -> None:
    from benchmarks.blind.machine import NOMINAL, record

    made = record({'coulomb_friction.x': {'coulomb_positive': 5.0, 'coulomb_negative': 5.0}}, 3,
                  ('x',), 8.0)  # fmt: skip
    axis, period = NOMINAL['axes']['x'], 1e-3
    q, vc = made.encoder[:, 0], made.velocity_command[:, 0]
    decay = np.exp(-period * axis['velocity_filter'])
    vf, integral, expected = 0.0, 0.0, []
    for k in range(len(q)):
        vf = decay * vf + (1.0 - decay) * (q[k] - q[max(k - 1, 0)]) / period
        expected.append(axis['velocity_gain'] * (vc[k] - vf) + integral)
        integral += axis['integral_gain'] * (vc[k] - vf) * period
    np.testing.assert_allclose(made.force[:, 0], expected, atol=1e-6)
