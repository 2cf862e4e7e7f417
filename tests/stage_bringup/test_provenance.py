"""A session says which code has run it."""

from __future__ import annotations

import subprocess
from pathlib import Path

from stage_bringup.provenance import provenance


def test_commit_and_changes_of_a_checkout(tmp_path: Path) -> None:
    source = tmp_path / 'source.py'
    source.write_text('a = 1\n')

    def git(*words: str) -> str:
        identity = ['-c', 'user.name=a', '-c', 'user.email=a@example.org']
        command = ['git', '-C', str(tmp_path), *identity, *words]
        return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()

    assert set(provenance(source)) == {'recorded'}
    git('init', '-q')
    assert set(provenance(source)) == {'recorded'}
    git('add', '.')
    git('commit', '-q', '-m', 'one')
    (tmp_path / 'notes.txt').write_text('what git does not know changes no code\n')
    found = provenance(source)
    assert found['commit'] == git('rev-parse', '--short', 'HEAD')
    assert found['changed'] is False
    source.write_text('a = 2\n')
    assert provenance(source)['changed'] is True
