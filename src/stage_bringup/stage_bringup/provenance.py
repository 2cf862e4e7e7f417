"""When a session was run and by which state of the code."""

from __future__ import annotations

import subprocess
from datetime import datetime
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve()


def provenance(source: Path = HERE) -> dict[str, Any]:
    """Local date and time, commit of the checkout of `source`, and whether its files differ.

    `commit` and `changed` are absent where `source` is in no git checkout, as when installed.
    """
    found: dict[str, Any] = {'recorded': datetime.now().astimezone().isoformat(timespec='seconds')}
    # An install inside of somebody's checkout is no file of it.
    if _git(source, 'ls-files', '--error-unmatch', source.name) is not None:
        found['commit'] = _git(source, 'rev-parse', '--short', 'HEAD')
        found['changed'] = bool(_git(source, 'status', '--porcelain', '--untracked-files=no'))
    return found


def _git(source: Path, *words: str) -> str | None:
    command = ['git', '-C', str(source.parent), *words]
    try:
        done = subprocess.run(command, capture_output=True, text=True)
    except FileNotFoundError:
        return None
    return done.stdout.strip() if done.returncode == 0 else None
