"""Executables of an installed workspace, or of this source tree."""

from __future__ import annotations

import ast
import hashlib
import os
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


def entry_points() -> dict[str, dict[str, str]]:
    """``module:function`` by package and name, of the literals in every ``setup.py``."""
    found: dict[str, dict[str, str]] = {}
    for setup in sorted(_SOURCE.glob('*/setup.py')):
        for node in ast.walk(ast.parse(setup.read_text(encoding='utf-8'))):
            if isinstance(node, ast.Dict) and 'console_scripts' in map(_literal, node.keys):
                for line in ast.literal_eval(node)['console_scripts']:
                    name, entry = (part.strip() for part in line.split('=', 1))
                    found.setdefault(entry.split('.')[0], {})[name] = entry
    return found


def _literal(node: ast.expr | None) -> object:
    return getattr(node, 'value', None)


def find(package: str, name: str, python: str) -> tuple[list[str], dict[str, str]]:
    """Command line and environment of an executable; an installed one wins.

    One of the source tree loads the kernels that `make` compiled.

    Raises
    ------
    StageError
        If the package or the executable does not exist.
    """
    for prefix in filter(None, os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep)):
        script = Path(prefix) / 'lib' / package / name
        if script.is_file() and os.access(script, os.X_OK):
            return [str(script)], dict(os.environ)
    known = entry_points()
    if package not in known:
        raise StageError(f"Package '{package}' not found: there are {', '.join(sorted(known))}")
    if name not in known[package]:
        names = ', '.join(sorted(known[package]))
        raise StageError(f'No executable found: package {package} has {names}')
    module, function = known[package][name].split(':')
    code = (
        f'import sys; sys.argv[0] = {name!r}; '
        f'from {module} import {function}; sys.exit({function}())'
    )
    return [python, '-c', code], {'NUMBA_CACHE_DIR': str(kernel_cache()), **os.environ}
