"""The colcon workspace builds with the ROS 2 at hand, and its launch files are Python."""

from __future__ import annotations

import ast
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]


@pytest.mark.parametrize('path', sorted((ROOT / 'ros_ws' / 'launch').glob('*.py')), ids=str)
def test_launch_file(path: Path) -> None:
    """`launch` is not on PyPI: syntax, and that every file it names is there."""
    tree = ast.parse(path.read_text())
    assert any(
        isinstance(n, ast.FunctionDef) and n.name == 'generate_launch_description'
        for n in tree.body
    )
    named = {
        n.value
        for n in ast.walk(tree)
        if isinstance(n, ast.Constant) and str(n.value).endswith('.yaml')
    }
    assert named
    assert not {n for n in named if not (ROOT / 'ros_ws' / 'config' / n).is_file()}


def test_colcon_build(tmp_path: Path) -> None:
    """Every package builds and its executables are where ros2 run looks for them."""
    colcon = Path(sys.executable).with_name('colcon')
    if not colcon.exists():
        found = shutil.which('colcon')
        if found is None:
            pytest.skip('colcon is not installed')
        colcon = Path(found)
    packages = sorted(p.parent for p in (ROOT / 'src').glob('*/package.xml'))
    # A copy: a build writes egg-info beside the sources.
    shutil.copytree(
        ROOT / 'src', tmp_path / 'src', ignore=shutil.ignore_patterns('__pycache__', '*.egg-info')
    )
    shutil.copytree(ROOT / 'ros_ws' / 'config', tmp_path / 'ros_ws' / 'config')
    shutil.copytree(ROOT / 'ros_ws' / 'launch', tmp_path / 'ros_ws' / 'launch')
    environment = {**os.environ, 'PATH': f'{colcon.parent}:{os.environ["PATH"]}'}
    done = subprocess.run(
        [str(colcon), '--log-base', str(tmp_path / 'log'), 'build']
        + ['--base-paths', 'src', '--build-base', 'build', '--install-base', 'install']
        + ['--executor', 'sequential'],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    for package in packages:
        share = tmp_path / 'install' / package.name / 'share'
        assert (share / 'ament_index/resource_index/packages' / package.name).is_file()
    assert (tmp_path / 'install/stage_driver/lib/stage_driver/stage_driver').is_file()
    assert (tmp_path / 'install/stage_bringup/share/stage_bringup/config').is_dir()
