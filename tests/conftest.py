"""What every test shares: one thread per process, a ROS domain per test."""

from __future__ import annotations

import fcntl
import os
import random
import tempfile
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
    domain, lock = _reserve_domain()
    values = {
        'ROS_DOMAIN_ID': str(domain),
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
    os.close(lock)


def _reserve_domain() -> tuple[int, int]:
    """A ROS domain that no other test run on this machine has, and the lock that holds it."""
    # Below 102: higher domains collide with the ephemeral ports of Linux.
    domains = list(range(1, 101))
    random.SystemRandom().shuffle(domains)
    for domain in domains:
        path = Path(tempfile.gettempdir()) / f'stage_test_domain_{domain}.lock'
        lock = os.open(path, os.O_CREAT | os.O_RDWR, 0o666)
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(lock)
            continue
        return domain, lock
    pytest.fail('all ROS domains 1 to 100 are in use by other test runs')


@pytest.fixture
def data_root() -> Path:
    """Folder of the real measurements; the test is skipped where it is absent."""
    path = Path(os.environ.get('STAGE_DATA', ROOT.parent / 'shared' / 'data'))
    if not path.is_dir():
        pytest.skip(f'the real measurements are not at {path} (set STAGE_DATA)')
    return path
