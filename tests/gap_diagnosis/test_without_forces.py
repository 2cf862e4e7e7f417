"""A session without effort, and a twin file without gains."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import yaml

from benchmarks.blind.machine import Recording, record
from benchmarks.without_forces import without_gains
from gap_diagnosis.__main__ import main
from gap_diagnosis.residuals import unrecorded
from stage_core.twin_file import GAINS

from .foreign import Message, Shape, machine, messages, twin, write_bag


def words(bag: Path, folder: Path) -> list[str]:
    """Arguments of a diagnosis of a bag with the file without gains."""
    (folder / 'twin.yaml').write_text(yaml.safe_dump(without_gains(twin())))
    own = ['diagnose', '--bag', str(bag), '--twin', str(folder / 'twin.yaml'), '--quiet']
    return [*own, '--out', str(folder / 'out')]


def report_of(bag: Path, folder: Path) -> dict:
    """The report of a bag, the page made with it."""
    assert main(words(bag, folder)) == 0
    return json.loads((folder / 'out' / 'report.json').read_text())


def diagnosed(shape: Shape, folder: Path) -> dict:
    """The report of the machine's session."""
    return report_of(write_bag(folder / 'bag', messages(machine(), shape)), folder)


@pytest.fixture
def no_law(monkeypatch: pytest.MonkeyPatch) -> None:
    """No law of a drive is good enough."""
    monkeypatch.setattr(unrecorded, 'AT_NOISE', 0.0)
    monkeypatch.setattr(unrecorded, 'WHILE_SLIDING', 0.0)


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


def without_commands(recording: Recording, shape: Shape) -> list[Message]:
    """The messages of a recorder that has not heard of `/stage/command`."""
    return [m for m in messages(recording, shape) if m[0] != '/stage/command']


def test_without_velocity_commands_the_position_gain_is_read_from_the_motion(
    tmp_path: Path,
) -> None:
    bag = write_bag(tmp_path / 'bag', without_commands(machine(), Shape()))
    report = report_of(bag, tmp_path)
    assert set(report['verdict']) == {'coulomb_friction.x', 'backlash.y'}
    for axis in 'xy':
        drive = report['without_forces']['controllers'][axis]
        assert drive['position_gain']['value'] == pytest.approx(40.0, rel=2e-3)
        assert drive['velocity_gain_over_mass']['value'] == pytest.approx(200.0, rel=0.1)


@pytest.mark.usefixtures('no_law')
def test_an_axis_whose_drive_no_law_explains_has_no_figures(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / 'bag', without_commands(machine(axes=('x',)), Shape()))
    report = report_of(bag, tmp_path)
    assert report['verdict'] == ['backlash.x', 'unknown']
    assert set(report['gap']['channels']) == {'tracker.x'}
    assert report['gap']['after'] < 1.5e-6 < report['gap']['before'] < 12e-6
    assert report['without_forces']['controllers'] == {'x': {'known': False}}
    assert any('Record the effort of /stage/command' in text for text in report['warnings'])
    gains = yaml.safe_load((tmp_path / 'out' / 'corrected_twin.yaml').read_text())['axes']['x']
    assert not set(GAINS) & set(gains)


@pytest.mark.usefixtures('no_law')
def test_coarse_steps_of_an_axis_that_no_loop_tells_are_named(tmp_path: Path) -> None:
    truth = {'backlash.x': {'width': 12e-6}, 'encoder_quantisation.x': {'resolution': 5e-6}}
    made = record(truth, 5, ('x',), 14.0, 100.0)
    report = report_of(write_bag(tmp_path / 'bag', without_commands(made, Shape())), tmp_path)
    assert set(report['verdict']) == {*truth, 'unknown'}


@pytest.mark.usefixtures('no_law')
def test_without_a_tracker_nothing_is_left_to_judge(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shape = Shape(tracker=False)
    bag = write_bag(tmp_path / 'bag', without_commands(machine(axes=('x',)), shape))
    assert main(words(bag, tmp_path)) == 2
    error = capsys.readouterr().err
    assert 'velocity commands are missing, too): record the effort' in error
    assert len(error.strip().splitlines()) == 1
