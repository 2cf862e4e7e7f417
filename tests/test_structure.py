"""What the layout promises: ROS only in node modules, packages that ROS 2 finds, sizes."""

from __future__ import annotations

import ast
import functools
import re
from pathlib import Path
from xml.etree import ElementTree

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = sorted(p for p in (ROOT / 'src').iterdir() if (p / 'package.xml').is_file())
MODULES = [m for p in PACKAGES for m in sorted(p.glob('*/**/*.py'))]
MESSAGES = re.compile(r'\w+_(msgs|srvs)$|rcl_interfaces$|rclpy$')


@functools.cache
def nodes(path: Path) -> list[ast.AST]:
    """Imports and functions of a module: each is parsed once."""
    kinds = (ast.Import, ast.ImportFrom, ast.FunctionDef, ast.AsyncFunctionDef)
    return [node for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, kinds)]


@functools.cache
def imported(path: Path) -> set[str]:
    names: set[str] = set()
    for node in nodes(path):
        if isinstance(node, ast.Import):
            names |= {alias.name.split('.')[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and node.level == 0:
            names.add(node.module.split('.')[0])
    return names


def test_there_are_packages() -> None:
    assert 8 <= len(PACKAGES) <= 10


@pytest.mark.parametrize('module', MODULES, ids=lambda m: str(m.relative_to(ROOT / 'src')))
def test_module(module: Path) -> None:
    """Only node modules import ROS; stage_core imports no sibling."""
    names = imported(module)
    if not re.search(r'(^|_)node$', module.stem):
        assert not {n for n in names if MESSAGES.match(n)}
    if 'stage_core' in module.parts:
        assert not names & ({p.name for p in PACKAGES} - {'stage_core'})


def test_no_module_grows_too_long() -> None:
    written = (
        p for name in ('src', 'benchmarks', 'tools', 'tests') for p in (ROOT / name).rglob('*.py')
    )
    lengths = {str(path): len(path.read_text().splitlines()) for path in written}
    assert {path: n for path, n in lengths.items() if n > 350} == {}


def test_no_function_grows_too_long() -> None:
    written = (p for name in ('src', 'benchmarks', 'tools') for p in (ROOT / name).rglob('*.py'))
    lengths = {
        f'{path}: {node.name}': node.end_lineno - node.lineno + 1
        for path in written
        for node in nodes(path)
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and node.end_lineno
    }
    assert {name: n for name, n in lengths.items() if n > 60} == {}


@pytest.mark.parametrize('package', PACKAGES, ids=lambda p: p.name)
def test_package_metadata(package: Path) -> None:
    """Name, licence, build type, marker, README; what is imported is declared."""
    root = ElementTree.parse(package / 'package.xml').getroot()
    assert root.findtext('name') == package.name
    assert root.findtext('license') == 'Apache-2.0'
    assert root.findtext('export/build_type') == 'ament_python'
    assert (package / 'resource' / package.name).is_file()
    assert (package / 'README.md').is_file()
    declared = {e.text for e in root.findall('exec_depend')} | {package.name}
    siblings = {p.name for p in PACKAGES}
    used = set().union(*(imported(m) for m in package.glob('*/**/*.py')))
    assert used & siblings <= declared
    assert {n for n in used if MESSAGES.match(n)} <= declared


#: A file of /proc, the file that `repair` writes beside a bag, and what writes files whole.
NOT_WHOLE = {'keep_awake.py', 'repair.py', 'whole_file.py'}


def test_files_are_written_whole() -> None:
    """A file that somebody may read later goes through `stage_core.whole_file`."""
    writes = re.compile(r"\.write_(text|bytes)\(|open\([^)]*'w[b']|np\.savez\((?!stream|file|\n)")
    found = [m for m in MODULES if writes.search(m.read_text()) and m.name not in NOT_WHOLE]
    assert not found
