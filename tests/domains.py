"""A ROS domain that no other test or benchmark on this machine uses."""

from __future__ import annotations

import fcntl
import os
import random
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


def reserve_domain() -> int:
    """Choose a free domain for this process and its children; the descriptor that holds it.

    It is held until the descriptor is closed or the process ends.

    Raises
    ------
    RuntimeError
        If all are in use.
    """
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
        os.environ['ROS_DOMAIN_ID'] = str(domain)
        return lock
    raise RuntimeError('all ROS domains 1 to 100 are in use by other test runs')


@contextmanager
def own_domain(**values: str | None) -> Iterator[None]:
    """Reserve a domain and set other variables (None removes one); all are put back at the end."""
    names = ('ROS_DOMAIN_ID', *values)
    before = {name: os.environ.get(name) for name in names}
    lock = reserve_domain()
    _set(values)
    try:
        yield
    finally:
        _set(before)
        os.close(lock)


def _set(values: dict[str, str | None]) -> None:
    for name, value in values.items():
        if value is None:
            os.environ.pop(name, None)
        else:
            os.environ[name] = value
