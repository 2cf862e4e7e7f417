"""A session without effort, and a twin file without gains."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import yaml

from gap_diagnosis.__main__ import main
from stage_core.twin_file import GAINS

from .foreign import Shape, machine, messages, twin, write_bag

BESIDE = ('velocity_feedforward', 'delay')


def without_gains() -> dict:
    """The machine's twin file with nothing of its controller."""
    content = twin()
    axes = {
        name: {k: v for k, v in axis.items() if k not in (*GAINS, *BESIDE)}
        for name, axis in content['axes'].items()
    }
    return {**content, 'axes': axes}


def diagnosed(shape: Shape, folder: Path) -> dict:
    """The report of the machine's session, the page made with it."""
    bag = write_bag(folder / 'bag', messages(machine(), shape))
    (folder / 'twin.yaml').write_text(yaml.safe_dump(without_gains()))
    words = ['diagnose', '--bag', str(bag), '--twin', str(folder / 'twin.yaml'), '--quiet']
    assert main([*words, '--out', str(folder / 'out')]) == 0
    return json.loads((folder / 'out' / 'report.json').read_text())


def test_without_effort_force_over_mass_is_told_and_the_mass_is_not(tmp_path: Path) -> None:
    report = diagnosed(Shape(effort=False), tmp_path)
    assert set(report['verdict']) == {'coulomb_friction.x', 'backlash.y'}
    drive = report['without_forces']['controllers']['y']
    assert drive['position_gain']['value'] == pytest.approx(40.0, rel=1e-3)
    # A slower filter of the speed acts as a little mass: the two are hardly told apart.
    assert drive['velocity_gain_over_mass']['value'] == pytest.approx(200.0, rel=0.1)
    friction = next(
        row for row in report['without_forces']['over_mass'] if row['parameter'] == 'coulomb'
    )
    assert friction['value'] == pytest.approx(8.0 / 18.0, rel=0.05) and friction['unit'] == 'm/s²'
    lost = {entry['effect'] for entry in report['not_identifiable']}
    assert {'inertia_mismatch.x', 'drive_gain.y'} <= lost
    assert 'Without forces' in (tmp_path / 'out' / 'report.html').read_text()


def test_with_effort_the_gains_are_read_from_the_commands(tmp_path: Path) -> None:
    report = diagnosed(Shape(), tmp_path)
    assert set(report['verdict']) == {'coulomb_friction.x', 'backlash.y'}
    assert 'without_forces' not in report
    gains = yaml.safe_load((tmp_path / 'out' / 'corrected_twin.yaml').read_text())['axes']['y']
    assert gains['velocity_gain'] == pytest.approx(1600.0, rel=0.01)
