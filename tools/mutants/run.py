"""Tries mutants in a copy of the checkout against the tests that cover their file."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path

from .draw import ROOT, Mutant, find

KEPT = ROOT / '.cache' / 'mutants.json'
#: Folders of tests that cover a package, where the name is not the package's.
FOLDERS = {
    'stage_bringup': ['stage_bringup', 'stage_reports', 'ros2_standin'],
    'stage_twin': ['stage_twin', 'stage_twin_node'],
}
#: A parameter in a test's name may hold spaces.
FAILED = re.compile(r'^(?:FAILED|ERROR) (.+?)(?: - .*)?$', re.MULTILINE)
CAUGHT, SURVIVED, UNFINISHED, GONE = 'caught', 'survived', 'not finished', 'no such place'


@dataclass(frozen=True)
class Result:
    """What became of a mutant; `test` is the one that caught it."""

    mutant: Mutant
    outcome: str
    test: str
    seconds: float
    commit: str


class Trial:
    """A copy of the tracked files in which one mutant after another is applied."""

    def __init__(self, seconds: float) -> None:
        self.seconds = seconds
        self.commit = _git('rev-parse', '--short', 'HEAD').strip()
        self.root = Path(tempfile.gettempdir()) / f'mutants-{os.getuid()}' / 'copy'
        shutil.rmtree(self.root, ignore_errors=True)
        for name in _git('ls-files').splitlines():
            (self.root / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, self.root / name, follow_symlinks=False)

    def of(self, mutant: Mutant) -> Result:
        """Result of a mutant, from an earlier run where one has come to an end."""
        known = next((r for r in results() if r.mutant == mutant), None)
        if known and (known.outcome != UNFINISHED or known.seconds >= self.seconds):
            return known
        start = time.monotonic()
        outcome, test = self._try(mutant)
        result = Result(mutant, outcome, test, time.monotonic() - start, self.commit)
        _keep(result)
        return result

    def _try(self, mutant: Mutant) -> tuple[str, str]:
        found = find(mutant, self.root)
        if found is None:
            return GONE, ''
        path, text = found
        files = self._tests(mutant)
        deselected: list[str] = []
        end = time.monotonic() + self.seconds
        while True:
            with _replaced(path, text), _kernels('numba' in text) as cache:
                outcome, test = self._pytest([*files, *deselected], cache, end)
            if outcome != CAUGHT or not test:
                return outcome, test
            # A test that fails without the mutant as well says nothing about it.
            with _kernels(False) as cache:
                alone, _ = self._pytest([test], cache, time.monotonic() + self.seconds)
            if alone == SURVIVED:
                return CAUGHT, test
            deselected.append(f'--deselect={test}')

    def _tests(self, mutant: Mutant) -> list[str]:
        """Test files of the package: those that name the function or the module come first.

        Then come the shorter ones.
        """
        folders = FOLDERS.get(mutant.package, [mutant.package])
        own = [p for name in folders for p in (self.root / 'tests' / name).glob('test_*.py')]
        words = {*mutant.function.split('.'), Path(mutant.file).stem}

        def named(path: Path) -> int:
            text = path.read_text()
            return sum(bool(re.search(rf'\b{word}\b', text)) for word in words)

        own.sort(key=lambda path: (-named(path), path.stat().st_size))
        return [str(path.relative_to(self.root)) for path in own]

    def _pytest(self, words: list[str], cache: str, end: float) -> tuple[str, str]:
        """Run the tests until one fails or the time is up."""
        sources = os.pathsep.join(str(p) for p in (self.root / 'src').iterdir())
        environment = {**os.environ, 'PYTHONPATH': sources, 'NUMBA_CACHE_DIR': cache}
        environment.setdefault('STAGE_DATA', str(ROOT.parent / 'shared' / 'data'))
        command = [sys.executable, '-m', 'pytest', '-q', '-x', '--tb=no', '-rfE', *words]
        with subprocess.Popen(
            command, cwd=self.root, env=environment, text=True, start_new_session=True,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        ) as process:  # fmt: skip
            try:
                output = process.communicate(timeout=max(1.0, end - time.monotonic()))[0]
            except subprocess.TimeoutExpired:
                os.killpg(process.pid, 9)
                return UNFINISHED, ''
        if process.returncode == 0:
            return SURVIVED, ''
        if process.returncode < 0:
            # A kernel that writes beside its arrays ends the interpreter.
            return CAUGHT, ''
        failed = FAILED.search(output)
        if failed is None:
            raise RuntimeError(output[-2000:])
        return CAUGHT, failed[1]


@contextmanager
def _replaced(path: Path, text: str) -> Iterator[None]:
    """Put another text into a file for a while."""
    before = path.read_text()
    path.write_text(text)
    try:
        yield
    finally:
        path.write_text(before)


@contextmanager
def _kernels(own: bool) -> Iterator[str]:
    """Folder of compiled kernels: a changed kernel has its own, for its callers hold it."""
    if not own:
        yield str(Path(tempfile.gettempdir()) / f'mutants-{os.getuid()}' / 'kernels')
        return
    with tempfile.TemporaryDirectory() as folder:
        yield folder


def results() -> list[Result]:
    """Return what earlier runs found, the newest of each mutant."""
    if not KEPT.is_file():
        return []
    entries = json.loads(KEPT.read_text())
    return [Result(**{**entry, 'mutant': Mutant(**entry['mutant'])}) for entry in entries]


def _keep(result: Result) -> None:
    kept = [r for r in results() if r.mutant != result.mutant]
    KEPT.parent.mkdir(exist_ok=True)
    KEPT.write_text(json.dumps([asdict(r) for r in [*kept, result]], indent=1))


def _git(*words: str) -> str:
    return subprocess.run(
        ['git', *words], cwd=ROOT, check=True, capture_output=True, text=True
    ).stdout
