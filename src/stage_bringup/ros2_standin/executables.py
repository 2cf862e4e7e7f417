"""Packages and their executables: of an installed workspace, or of this source tree."""

from __future__ import annotations

import ast
import hashlib
import os
from dataclasses import dataclass
from pathlib import Path

from stage_core.errors import StageError

#: The folder ``src`` of the workspace, when the package runs from its source tree.
_SOURCE = Path(__file__).resolve().parents[2]


def kernel_cache() -> Path:
    """Folder of the compiled kernels of this state of the sources, as the Makefile has it.

    Numba does not notice that a kernel's callee changed, so each state has a folder of its own.
    """
    files = [*sorted(_SOURCE.glob('*/*/*.py')), *sorted(_SOURCE.glob('*/*/*/*.py'))]
    state = hashlib.sha1(b''.join(path.read_bytes() for path in files)).hexdigest()[:12]
    return _SOURCE.parent / '.cache' / 'numba' / state


@dataclass(frozen=True)
class Executable:
    """One executable: a file of an installed package, or ``module:function`` of a source one."""

    package: str
    name: str
    entry: str = ''
    file: Path | None = None


def packages() -> dict[str, list[Executable]]:
    """Executables by package; installed ones win over those of the source tree."""
    found: dict[str, list[Executable]] = {}
    for setup in sorted(_SOURCE.glob('*/setup.py')):
        if (setup.parent / 'package.xml').is_file():
            found.setdefault(setup.parent.name, [])
            for name, entry in _entry_points(setup):
                package = entry.split('.')[0]
                found.setdefault(package, []).append(Executable(package, name, entry=entry))
    for prefix in os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep):
        index = Path(prefix) / 'share' / 'ament_index' / 'resource_index' / 'packages'
        for marker in sorted(index.glob('*')) if prefix and index.is_dir() else ():
            scripts = sorted((Path(prefix) / 'lib' / marker.name).glob('*'))
            installed = [
                Executable(marker.name, script.name, file=script)
                for script in scripts
                if script.is_file() and os.access(script, os.X_OK)
            ]
            if installed or marker.name not in found:
                found[marker.name] = installed
    return found


def _entry_points(setup: Path) -> list[tuple[str, str]]:
    """Console scripts (name, ``module:function``) that a ``setup.py`` declares as literals."""
    for node in ast.walk(ast.parse(setup.read_text(encoding='utf-8'))):
        if not isinstance(node, ast.Dict):
            continue
        for key, value in zip(node.keys, node.values, strict=True):
            if isinstance(key, ast.Constant) and key.value == 'console_scripts':
                lines = ast.literal_eval(value)
                pairs = (line.split('=', 1) for line in lines)
                return sorted((name.strip(), entry.strip()) for name, entry in pairs)
    return []


def find(package: str, name: str) -> Executable:
    """One executable of a package.

    Raises
    ------
    StageError
        If the package or the executable does not exist.
    """
    known = packages()
    if package not in known:
        raise StageError(f"Package '{package}' not found: `ros2 pkg list` names the packages")
    for executable in known[package]:
        if executable.name == name:
            return executable
    names = ', '.join(e.name for e in known[package]) or 'none'
    raise StageError(f'No executable found: package {package} has {names}')


def environment(executable: Executable) -> dict[str, str]:
    """Environment of an executable: one of the source tree loads what `make` compiled."""
    own = {} if executable.file is not None else {'NUMBA_CACHE_DIR': str(kernel_cache())}
    return {**own, **os.environ}


def command(executable: Executable, arguments: list[str], python: str) -> list[str]:
    """Command line that starts an executable."""
    if executable.file is not None:
        return [str(executable.file), *arguments]
    module, function = executable.entry.split(':')
    code = (
        f'import sys; sys.argv[0] = {executable.name!r}; '
        f'from {module} import {function}; sys.exit({function}())'
    )
    return [python, '-c', code, *arguments]
