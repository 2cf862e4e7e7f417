"""What every test shares: one thread per process, a ROS domain per test."""

from __future__ import annotations

import gc
import os
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest

from .domains import own_domain

# Set before NumPy loads: small matrices run slower on many threads, and two cores are shared.
for _name in ('OPENBLAS_NUM_THREADS', 'OMP_NUM_THREADS'):
    os.environ.setdefault(_name, '1')
os.environ.setdefault('MPLBACKEND', 'Agg')
# A shell's background job ignores SIGINT, and so would every process that a test interrupts.
signal.signal(signal.SIGINT, signal.default_int_handler)

ROOT = Path(__file__).resolve().parents[1]
#: Folders and files that take minutes: they begin first, so that no process waits for another.
SLOW = {
    'reliability', 'gap_diagnosis', 'contour_ctrl', 'stage_bringup', 'stage_driver',
    'stage_twin_node', 'test_workspace', 'test_zoo', 'test_new_effect', 'test_figures',
}  # fmt: skip


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with what is slow; all else stays in order."""
    items.sort(key=lambda item: not SLOW & {item.path.parent.name, item.path.stem})


def pytest_collection_finish() -> None:
    """Thousands of tests stay until the end: no collection of garbage looks through them again."""
    gc.collect()
    gc.freeze()


@pytest.fixture
def ros_env() -> Iterator[dict[str, str]]:
    """Environment of the processes of one test: a domain of its own, this machine only.

    Also set in this process, so that a client in the test joins the same graph.
    """
    profile = ROOT / 'src' / 'stage_core' / 'stage_core' / 'ros' / 'fastdds_local.xml'
    with own_domain(
        ROS_AUTOMATIC_DISCOVERY_RANGE='LOCALHOST', FASTRTPS_DEFAULT_PROFILES_FILE=str(profile)
    ):
        yield dict(os.environ)


@pytest.fixture
def data_root() -> Path:
    """Folder of the real measurements; the test is skipped where it is absent."""
    path = Path(os.environ.get('STAGE_DATA', ROOT.parent / 'shared' / 'data'))
    if not path.is_dir():
        pytest.skip(f'the real measurements are not at {path} (set STAGE_DATA)')
    return path


@pytest.fixture(scope='session')
def dask_cluster() -> Iterator[str]:
    """Address of a Dask scheduler with two workers, each a process of one thread."""
    dask = pytest.importorskip('dask', reason='Dask is an optional extra')
    distributed = pytest.importorskip('distributed', reason='Dask is an optional extra')
    settings = {
        # A loaded machine takes its time to start processes.
        'distributed.comm.timeouts.connect': '120s',
        # An item that ends its worker is not given to another one.
        'distributed.scheduler.allowed-failures': 0,
    }
    with (
        dask.config.set(settings),
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=':0'
        ) as cluster,
    ):
        yield cluster.scheduler_address
