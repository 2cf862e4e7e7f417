"""Arguments of the command that cannot be meant: one line, exit status 2, before any work."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from gap_diagnosis import service
from gap_diagnosis.__main__ import main
from gap_diagnosis.archive import diagnose_archive
from gap_diagnosis.experiment.propose import propose
from gap_diagnosis.result import Diagnosis
from session_bags.archive import Where
from session_bags.writer import write_session
from stage_core import topics
from stage_core.errors import StageError
from stage_core.session import Series, Session
from stage_core.twin_file import TwinFile

Maker = Callable[..., Session]


@pytest.fixture(scope='module')
def files(planted: Maker, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a bag, its twin, and a file that is no folder."""
    folder = tmp_path_factory.mktemp('arguments')
    write_session(folder / 'bag', planted({}, duration=4.0))
    TwinFile.nominal_servo().save(folder / 'twin.yaml')
    (folder / 'file').write_text('')
    return folder


@pytest.mark.parametrize(
    ('words', 'said'),
    [
        ('--out {}/file', 'cannot write into .*file'),
        ('--out {}/file/below', 'cannot write into .*below'),
        ('--out /proc/report', 'cannot write into /proc/report'),
        ('--out {}/o --without backslash', 'backslash.*did you mean backlash'),
        ('--out {}/o --without backlash.z', 'backlash.z: name it backlash or backlash.x or'),
        ('--out {}/o --without nonorthogonality.x', 'name it nonorthogonality$'),
        ('--out {}/o --seed -1', '--seed -1'),
        ('--out {}/o --travel z:0:1', '--travel z: the twin has the axes x, y only'),
        ('--out {}/o --travel x:-inf:0', 'both finite'),
        ('--out {}/o --holdout {}/bag', 'bag is given twice'),
        ('--out {}/o --bag {}/../{name}/bag', 'bag is given twice'),
    ],
)
def test_what_cannot_be_meant_is_refused(
    files: Path, capsys: pytest.CaptureFixture[str], words: str, said: str
) -> None:
    named = words.replace('{name}', files.name).replace('{}', str(files))
    bag = ['--bag', str(files / 'bag'), '--twin', str(files / 'twin.yaml')]
    assert main(['diagnose', *bag, *named.split()]) == 2
    error = capsys.readouterr().err.strip().splitlines()
    assert re.search(said, error[-1]), error
    assert len([line for line in error if not line.startswith('[gap_diagnosis]')]) == 1


def test_a_folder_of_bags_passes_the_travel_on(
    files: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    seen: list[Any] = []

    def run(*_: Any, **how: Any) -> None:
        seen.append(how['travel'])
        raise StageError('seen')

    monkeypatch.setattr(service, 'run', run)
    words = ['--bag', str(files), '--twin', str(files / 'twin.yaml'), '--out', str(tmp_path)]
    assert main([*words, '--travel', 'x:-0.1:0.1', '--jobs', '1', '--quiet']) == 2
    assert seen == [{'x': (-0.1, 0.1)}]


def test_a_folder_of_bags_needs_a_folder_to_write_into(files: Path) -> None:
    twin = str(files / 'twin.yaml')
    with pytest.raises(StageError, match='cannot write into'):
        diagnose_archive(files, twin, files / 'file', where=Where(1, '', False))


def first_without_time(session: Session) -> Session:
    """As stamped by a driver that has not heard the simulated clock at its first tick."""

    def stamped(topic: str, old: Series) -> Series:
        stamps = old.stamps.copy()
        if topic != topics.TRACKER_POINT:
            stamps[0] = 0
        return replace(old, stamps=stamps)

    return replace(session, series={k: stamped(k, s) for k, s in session.series.items()})


def test_a_stamp_far_from_the_others_is_named(
    planted: Maker, files: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = write_session(tmp_path / 'bag', first_without_time(planted({}, duration=4.0)))
    words = ['--bag', str(bag), '--twin', str(files / 'twin.yaml'), '--quiet']
    assert main([*words, '--out', str(tmp_path / 'out')]) == 2
    error = capsys.readouterr().err
    assert re.search(
        r'lacks 100 %.*/stage/\w+ is [\d.]+e\+09 s, after its message number 1\)', error
    )


@pytest.mark.parametrize(
    'wrong', [{'axes': {'x': {'mass': 1.0, 'viscous': 1.0, 'delay': -1e-3}}},
              {'tracker': {'noise': -1e-6}}, {'repeatability': -1e-6}],
)  # fmt: skip
def test_a_twin_that_answers_before_its_cause_is_refused(wrong: dict[str, Any]) -> None:
    content = {'kind': 'servo', 'axes': {'x': {'mass': 1.0, 'viscous': 1.0}}, **wrong}
    with pytest.raises(StageError, match='must be at least zero'):
        TwinFile.from_dict(content)


def test_a_session_whose_forces_are_not_judged_has_no_experiment() -> None:
    tracker = SimpleNamespace(name='tracker')
    found = SimpleNamespace(twin=TwinFile.nominal_servo(), drives={}, parts=[tracker])
    assert propose(cast(Diagnosis, found)) is None


def test_ctrl_c_ends_the_command_without_a_traceback(
    files: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def run(*_: Any, **how: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr('gap_diagnosis.__main__.run', run)
    words = ['--bag', str(files / 'bag'), '--twin', 'twin.yaml', '--out', 'out']
    assert main(words) == 130
    assert capsys.readouterr().err == ''
