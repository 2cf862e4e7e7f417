"""What every test shares: one thread per process, a ROS domain per test."""

from __future__ import annotations

import os
import random
from collections.abc import Iterator
from pathlib import Path

import pytest

# Set before NumPy loads: small matrices run slower on many threads, and two cores are shared.
for _name in ('OPENBLAS_NUM_THREADS', 'OMP_NUM_THREADS'):
    os.environ.setdefault(_name, '1')
os.environ.setdefault('MPLBACKEND', 'Agg')

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture
def ros_env() -> Iterator[dict[str, str]]:
    """Environment of the processes of one test: a domain of its own, this machine only.

    Also set in this process, so that a client in the test joins the same graph.
    """
    # Below 102: higher domains collide with the ephemeral ports of Linux.
    values = {
        'ROS_DOMAIN_ID': str(random.SystemRandom().randint(1, 100)),
        'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
        'FASTRTPS_DEFAULT_PROFILES_FILE': str(
            ROOT / 'src' / 'stage_node' / 'stage_node' / 'fastdds_local.xml'
        ),
    }
    before = {name: os.environ.get(name) for name in values}
    os.environ.update(values)
    yield dict(os.environ)
    for name, value in before.items():
        if value is None:
            os.environ.pop(name, None)
        else:
            os.environ[name] = value


@pytest.fixture
def data_root() -> Path:
    """Folder of the real measurements; the test is skipped where it is absent."""
    path = Path(os.environ.get('STAGE_DATA', ROOT.parent / 'shared' / 'data'))
    if not path.is_dir():
        pytest.skip(f'the real measurements are not at {path} (set STAGE_DATA)')
    return path
