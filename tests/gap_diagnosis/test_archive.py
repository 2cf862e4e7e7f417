"""Diagnosis of an archive: a report per bag, bad bags skipped, nothing done twice."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from gap_diagnosis.__main__ import main
from session_bags.writer import write_session
from stage_core.session import Session
from stage_core.twin_file import TwinFile

Maker = Callable[..., Session]


def with_a_still_one(archive: Path, planted: Maker) -> list[str]:
    """Arguments that diagnose an archive, to which a session that does not move is added."""
    write_session(archive / 'still', planted({}, duration=1.0))
    twin = archive.parent / 'twin.yaml'
    TwinFile.nominal_servo().save(twin)
    arguments = ['diagnose', '--bag', str(archive), '--twin', str(twin), '--quiet', '--jobs', '1']
    return [*arguments, '--out', str(archive.parent / 'out')]


def test_an_archive_is_diagnosed_bag_by_bag(
    planted: Maker, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    archive = tmp_path / 'archive'
    for number, width in enumerate((9e-6, 15e-6)):
        session = planted({'backlash.x': {'width': width}}, duration=10.0, seed=number)
        write_session(archive / f'day_{number}' / 'run', session)
    # Drawing a page takes longer than the diagnosis; how it looks is tested elsewhere.
    arguments = [*with_a_still_one(archive, planted), '--no-page']
    assert main(arguments) == 0
    said = capsys.readouterr().out
    assert '2 of 3 bags diagnosed' in said
    assert '2 of 2  backlash.x' in said
    assert 'still' in said and 'skipped: ' in said
    for row in json.loads((tmp_path / 'out' / 'summary.json').read_text())[:2]:
        assert (tmp_path / 'out' / row['report']).is_file()
    assert not list((tmp_path / 'out').rglob('*.html'))
    # Nothing is left to do.
    kept = {p: p.stat().st_mtime_ns for p in (tmp_path / 'out' / 'reports').rglob('report.json')}
    assert main(arguments) == 0
    assert capsys.readouterr().out == said
    assert all(path.stat().st_mtime_ns == stamp for path, stamp in kept.items())


def test_a_folder_is_given_alone(
    planted: Maker, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    archive = tmp_path / 'archive'
    arguments = with_a_still_one(archive, planted)
    assert main([*arguments, '--holdout', str(archive / 'still')]) == 2
    assert 'give it alone' in capsys.readouterr().err
    assert main(arguments) == 2
    assert 'no bag can be diagnosed' in capsys.readouterr().err
