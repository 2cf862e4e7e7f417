"""One function over an archive of bags: on all cores, or on a Dask cluster."""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from tqdm import tqdm

from stage_core.errors import StageError

#: Takes the path of a bag and returns what JSON can hold; must be importable by name.
BagFunction = Callable[[str], Any]


@dataclass(frozen=True)
class Outcome:
    """What a bag gave: its result, or the error for which it was skipped."""

    bag: str
    result: Any = None
    error: str = ''


def find_bags(directory: str | Path) -> list[Path]:
    """Bags in a directory and below, sorted; the directory itself if it is one.

    Raises
    ------
    StageError
        If there is none.
    """
    directory = Path(directory)
    if directory.is_file():
        return [directory]
    found = {path.parent for path in directory.rglob('metadata.yaml')}
    found |= {path.parent for path in directory.rglob('*.mcap')}
    if not found:
        raise StageError(f'{directory} holds no bag: name a directory of session bags')
    return sorted(found)


def result_path(folder: Path, bag: Path) -> Path:
    """File that keeps a bag's result: its name, and a hash of its path against namesakes."""
    digest = hashlib.sha256(str(bag.resolve()).encode()).hexdigest()[:10]
    return folder / f'{re.sub(r"[^A-Za-z0-9_.-]", "_", bag.name)}-{digest}.json'


def map_bags(
    function: BagFunction,
    bags: Sequence[Path],
    results: str | Path,
    *,
    jobs: int | None = None,
    scheduler: str = '',
    progress: bool = True,
) -> list[Outcome]:
    """Apply a function to every bag; outcomes in the order of `bags`.

    A result is kept in a file of the folder `results` as soon as it is there, and a bag that
    has one is not done again: an interrupted run goes on where it was. A bag that fails is
    reported in its outcome and tried again next time.

    Parameters
    ----------
    function
        From the path of a bag to what JSON can hold.
    jobs
        Processes on this machine; all its cores where not given.
    scheduler
        Address of a Dask scheduler to use in their place.

    Raises
    ------
    StageError
        If the scheduler cannot be reached, or Dask is not installed.
    """
    folder = Path(results)
    folder.mkdir(parents=True, exist_ok=True)
    outcomes: dict[Path, Outcome | None] = {bag: _kept(folder, bag) for bag in bags}
    missing = [bag for bag in bags if outcomes[bag] is None]
    if scheduler:
        stream = _on_cluster(function, missing, scheduler)
    else:
        stream = _on_this_machine(function, missing, jobs or os.cpu_count() or 1)
    with tqdm(total=len(bags), initial=len(bags) - len(missing), disable=not progress) as bar:
        for bag, outcome in stream:
            outcomes[bag] = outcome
            if not outcome.error:
                _keep(folder, bag, outcome)
            elif progress:
                tqdm.write(f'skipped {bag}: {outcome.error}')
            bar.update()
    return [kept for bag in bags if (kept := outcomes[bag]) is not None]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare ``--jobs`` and ``--scheduler``."""
    parser.add_argument('--jobs', type=int, help='processes on this machine; default: its cores')
    parser.add_argument('--scheduler', default='', help='address of a Dask scheduler to use')


def apply(function: BagFunction, bag: str) -> Outcome:
    """Outcome of one bag; no error of one bag ends the run of the others."""
    try:
        return Outcome(bag, function(bag))
    except StageError as error:
        return Outcome(bag, error=str(error))
    except Exception as error:
        return Outcome(bag, error=f'{type(error).__name__}: {error}')


def _kept(folder: Path, bag: Path) -> Outcome | None:
    path = result_path(folder, bag)
    try:
        return Outcome(str(bag), json.loads(path.read_text(encoding='utf-8'))['result'])
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _keep(folder: Path, bag: Path, outcome: Outcome) -> None:
    path = result_path(folder, bag)
    temporary = path.with_suffix('.tmp')
    content = {'bag': outcome.bag, 'result': outcome.result}
    temporary.write_text(json.dumps(content), encoding='utf-8')
    os.replace(temporary, path)


Stream = Iterator[tuple[Path, Outcome]]


def _on_this_machine(function: BagFunction, bags: Sequence[Path], jobs: int) -> Stream:
    if jobs <= 1 or len(bags) <= 1:
        for bag in bags:
            yield bag, apply(function, str(bag))
        return
    # Spawned, not forked: the caller may run threads (rclpy, BLAS).
    with ProcessPoolExecutor(min(jobs, len(bags)), mp_context=get_context('spawn')) as pool:
        futures = {pool.submit(apply, function, str(bag)): bag for bag in bags}
        for future in as_completed(futures):
            yield futures[future], future.result()


def _on_cluster(function: BagFunction, bags: Iterable[Path], address: str) -> Stream:
    try:
        from distributed import Client
        from distributed import as_completed as as_they_come
    except ImportError as error:
        raise StageError(
            '--scheduler needs Dask: install the package `distributed`, or leave it out to use '
            'this machine'
        ) from error
    try:
        client = Client(address, timeout=10)
    except (OSError, TimeoutError, ValueError) as error:
        raise StageError(f'no Dask scheduler answers at {address}: check the address') from error
    with client:
        futures = {client.submit(apply, function, str(bag), pure=False): bag for bag in bags}
        for future in as_they_come(list(futures)):
            yield futures[future], future.result()
