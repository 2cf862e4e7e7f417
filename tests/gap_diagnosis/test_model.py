"""A model of MuJoCo as the twin: for each effect that it can say, the patch closes the gap."""

from __future__ import annotations

import json
import math
import subprocess
from pathlib import Path
from typing import Any

import pytest

from gap_diagnosis.__main__ import main
from stage_core.twin_file import TwinFile

from .models import bag, controller, stage

pytest.importorskip('mujoco', reason='the optional package mujoco is not installed')

FLOOR = 1e-6 / math.sqrt(12.0)  # of the encoder [m]


def diagnosed(folder: Path, model: Path, rig: Path, *more: str) -> dict[str, Any]:
    words = ['--bag', str(folder / 'bag'), '--twin', str(model), '--controller', str(rig)]
    status = main(['diagnose', *words, '--quiet', '--out', str(folder / 'out'), *more])
    assert status == 0
    return json.loads((folder / 'out' / 'report.json').read_text())


@pytest.mark.parametrize(
    ('real', 'effect', 'attribute', 'value', 'tolerance'),
    [
        ({'more': ' frictionloss="6"'}, 'coulomb_friction.x', 'frictionloss', 6.0, 0.02),
        ({'damping': 95.0}, 'viscous_friction.x', 'damping', 95.0, 0.02),
        ({'more': ' armature="3"'}, 'inertia_mismatch.x', 'armature', 3.0, 0.02),
        ({'mass': 16.0}, 'inertia_mismatch.x', 'mass', 16.0, 0.02),
        ({'more': ' stiffness="900" springref="0.01"'}, 'cable_force.x', 'stiffness', 900, 0.02),
        ({'motor': ' gear="0.85"'}, 'drive_gain.x', 'gear', 0.85, 0.02),
        ({'motor': ' forcerange="-12 12"'}, 'force_saturation.x', 'forcerange', -12.0, 0.02),
        ({'motor': ' delay="0.004" nsample="9"'}, 'actuation_delay.x', 'delay', 4e-3, 0.1),
        ({'lag': 0.005}, 'current_loop_lag.x', 'dynprm', 5e-3, 0.05),
        ({'tilt': 0.25}, 'force_offset.x', 'biasprm', 4.5, 0.02),
    ],
    ids=lambda v: v if isinstance(v, str) and '.' not in v else '',
)
def test_the_patched_model_moves_as_the_machine(
    tmp_path: Path,
    real: dict[str, Any],
    effect: str,
    attribute: str,
    value: float,
    tolerance: float,
) -> None:
    """The model with an effect, diagnosed against the model without it, patched, run again."""
    rig = controller(tmp_path, ('x',))
    bag(tmp_path / 'bag', stage(tmp_path / 'real.xml', **real), TwinFile.load(rig), duration=12.0)
    report = diagnosed(tmp_path, stage(tmp_path / 'stage.xml'), rig, '--no-page')
    assert [name for name in report['verdict'] if name != 'unknown'] == [effect]
    changes = {c['attribute']: c['new'] for c in report['model']['changes']}
    assert float(changes[attribute].split()[0]) == pytest.approx(value, rel=tolerance)
    run = report['model']['encoder']
    # Two encoders that count the same motion differ by up to √2 of the floor of one. A controller
    # that winds up at a limit amplifies their steps: 9 µm between runs of the very same limit.
    winds_up = effect.startswith('force_saturation')
    assert run['after'] < (0.01 * run['before'] if winds_up else 2.0 * FLOOR)
    # The controller takes a constant force up: no position shows it.
    assert run['before'] > 2.0 * FLOOR or effect.startswith('force_offset')


def test_what_a_model_has_already_is_no_gap(tmp_path: Path) -> None:
    rig = controller(tmp_path, ('x',))
    more = ' frictionloss="6" solreffriction="0.001 1" stiffness="900" armature="2"'
    model = stage(tmp_path / 'stage.xml', more, ' gear="1.5"', tilt=0.1)
    bag(tmp_path / 'bag', model, TwinFile.load(rig), duration=12.0)
    report = diagnosed(tmp_path, model, rig, '--no-page')
    assert report['verdict'] == []
    assert report['model']['changes'] == []
    assert (tmp_path / 'out' / 'corrected_model.patch').read_text() == ''


def test_the_patch_is_for_the_file_and_the_page_says_what_it_lacks(tmp_path: Path) -> None:
    rig = controller(tmp_path, ('x',))
    twin = TwinFile.load(rig).with_effects({'backlash.x': {'width': 12e-6}})
    real = stage(tmp_path / 'real.xml', ' frictionloss="6" solreffriction="0.001 1"')
    bag(tmp_path / 'bag', real, twin, duration=12.0)
    model = stage(tmp_path / 'stage.xml', ' solreffriction="0.001 1"')
    report = diagnosed(tmp_path, model, rig)
    assert set(report['verdict']) == {'coulomb_friction.x', 'backlash.x'}
    assert [e['effect'] for e in report['model']['cannot_say']] == ['backlash.x']
    out = tmp_path / 'out'
    subprocess.run(
        ['patch', '-p1', '-i', str(out / 'corrected_model.patch')], cwd=tmp_path, check=True
    )
    assert model.read_text() == (out / 'corrected_model.xml').read_text()
    page = (out / 'report.html').read_text()
    for words in ('Your model', 'frictionloss', 'what this file cannot say'):
        assert words in page


def test_model_and_controller_go_together(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rig, model = controller(tmp_path, ('x',)), stage(tmp_path / 'stage.xml')
    for more in (['--twin', str(model)], ['--twin', str(rig), '--controller', str(rig)]):
        words = ['diagnose', '--bag', str(tmp_path), '--out', str(tmp_path / 'out'), *more]
        assert main([*words, '--bag', 'no_bag']) == 2
        assert '--controller' in capsys.readouterr().err
