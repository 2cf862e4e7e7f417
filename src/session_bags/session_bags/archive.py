"""One function over many items (bags, restarts, cases): on all cores, or on a Dask cluster."""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import re
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from tqdm import tqdm

from stage_core.errors import StageError
from stage_core.whole_file import write_whole

#: Takes an item, for example the path of a bag, and returns what JSON can hold. A module's
#: function (or a `functools.partial` of one), so that other processes find it.
ItemFunction = Callable[[str], Any]

Stream = Iterator[tuple[str, 'Outcome']]

ENDED = 'the process that worked on it was ended: too little memory, or a crash'

#: Dask runs several items in one process where its workers have threads, but drawing and HDF5
#: are not made for that.
_ONE_AT_A_TIME = threading.Lock()


@dataclass(frozen=True)
class Outcome:
    """What an item gave: its result, or the error for which it was skipped."""

    item: str
    result: Any = None
    error: str = ''


@dataclass(frozen=True)
class Where:
    """Where items are worked on.

    Attributes
    ----------
    jobs
        Processes on this machine; 0 takes one per core.
    scheduler
        Address of a Dask scheduler to use in their place. Its workers must have these packages
        and see the same files under the same names.
    progress
        Whether a bar and the skipped items are shown on stderr.
    """

    jobs: int = 0
    scheduler: str = ''
    progress: bool = True


def find_bags(directory: str | Path) -> list[Path]:
    """Bags in a directory and below, sorted; the directory itself if it is one.

    Raises
    ------
    StageError
        If there is none.
    """
    directory = Path(directory)
    if not directory.exists():
        raise StageError(f'there is no bag {directory}: check the path')
    if is_bag(directory):
        return [directory]
    found = {path.parent for path in directory.rglob('metadata.yaml')}
    found |= {path.parent for path in directory.rglob('*.mcap')}
    if not found:
        raise StageError(f'{directory} holds no bag: name a session bag or a folder of them')
    return sorted(found)


def is_bag(path: str | Path) -> bool:
    """Whether a path is a bag, and not a folder of bags."""
    path = Path(path)
    return path.is_file() or (path / 'metadata.yaml').exists() or any(path.glob('*.mcap'))


def fingerprint(bag: str | Path) -> str:
    """Changes when a bag does: names, sizes and times of its files."""
    path = Path(bag)
    files = [path] if path.is_file() else sorted(path.glob('*'))
    return json.dumps([(f.name, (s := f.stat()).st_size, s.st_mtime_ns) for f in files])


def result_path(folder: Path, item: str, key: str = '') -> Path:
    """File of an item's result: its name, and a hash that tells it from namesakes."""
    digest = hashlib.sha256(f'{item}\n{key}'.encode()).hexdigest()[:16]
    return folder / f'{re.sub(r"[^A-Za-z0-9_.-]", "_", Path(item).name)}-{digest}.json'


def map_items(
    function: ItemFunction,
    items: Sequence[str],
    results: str | Path,
    key: Callable[[str], str] = str,
    where: Where | None = None,
) -> list[Outcome]:
    """Apply a function to every item; outcomes in the order of `items`.

    A result is kept in a file of the folder `results` as soon as it is there, and an item that
    has one is not done again: an interrupted run goes on where it was. An item that fails, even
    one that ends its process, is reported in its outcome and tried again next time.

    Parameters
    ----------
    key
        Of an item: all on which its result depends (options, the state of a file). A kept result
        counts only for the same key.

    Raises
    ------
    StageError
        If the scheduler cannot be reached or is lost, or Dask is not installed.
    """
    where = where or Where()
    folder = Path(results)
    folder.mkdir(parents=True, exist_ok=True)
    paths = {item: result_path(folder, item, key(item)) for item in items}
    outcomes = {item: _kept(item, path) for item, path in paths.items()}
    missing = [item for item, outcome in outcomes.items() if outcome is None]
    if where.scheduler and missing:
        stream = _on_cluster(function, missing, where.scheduler)
    else:
        stream = _on_this_machine(function, missing, where.jobs or os.cpu_count() or 1)
    done = len(items) - len(missing)
    with tqdm(total=len(items), initial=done, disable=not where.progress) as bar:
        for item, outcome in stream:
            outcomes[item] = outcome
            if not outcome.error:
                _keep(paths[item], outcome)
            elif where.progress:
                bar.write(f'skipped {item}: {outcome.error}', file=sys.stderr)
            bar.update()
    return [kept for item in items if (kept := outcomes[item]) is not None]


def map_bags(
    function: ItemFunction,
    bags: Sequence[Path],
    results: str | Path,
    settings: str = '',
    where: Where | None = None,
) -> list[Outcome]:
    """`map_items` over the paths of bags: kept results count while bag and `settings` stay."""
    paths = [str(bag.resolve()) for bag in bags]
    return map_items(function, paths, results, lambda p: settings + fingerprint(p), where)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare ``--jobs`` and ``--scheduler``."""
    parser.add_argument(
        '--jobs', type=int, default=0, help='processes for a folder of bags; default: one per core'
    )
    parser.add_argument(
        '--scheduler', default='', help='address of a Dask scheduler to use in their place'
    )


def where_from(options: argparse.Namespace, progress: bool = True) -> Where:
    """The place that the arguments of `add_arguments` name."""
    return Where(options.jobs, options.scheduler, progress)


def apply(function: ItemFunction, item: str) -> Outcome:
    """Outcome of one item; no error of one item ends the run of the others."""
    try:
        with _ONE_AT_A_TIME:
            return Outcome(item, function(item))
    except StageError as error:
        return Outcome(item, error=' '.join(str(error).split()))
    except Exception as error:
        return Outcome(item, error=f'{type(error).__name__}: {" ".join(str(error).split())}')


def _kept(item: str, path: Path) -> Outcome | None:
    try:
        return Outcome(item, json.loads(path.read_text(encoding='utf-8'))['result'])
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _keep(path: Path, outcome: Outcome) -> None:
    write_whole(path, json.dumps({'item': outcome.item, 'result': outcome.result}))


def _on_this_machine(function: ItemFunction, items: Sequence[str], jobs: int) -> Stream:
    if jobs <= 1 or len(items) <= 1:
        for item in items:
            yield item, apply(function, item)
        return
    yield from _each_alone(lambda some: _in_pool(function, some, jobs), items)


def _each_alone(
    outcomes: Callable[[Sequence[str]], Iterator[tuple[str, Outcome | None]]],
    items: Sequence[str],
) -> Stream:
    """Outcomes of items; a process that dies takes others along: each is tried again alone."""
    broken = []
    for item, outcome in outcomes(items):
        if outcome is None:
            broken.append(item)
        else:
            yield item, outcome
    for item in broken:
        for _, outcome in outcomes([item]):
            yield item, outcome or Outcome(item, error=ENDED)


def _in_pool(
    function: ItemFunction, items: Sequence[str], jobs: int
) -> Iterator[tuple[str, Outcome | None]]:
    """Outcomes as they come; None for items whose process died."""
    # Children read it when they load NumPy; more threads than cores slow all of them down.
    os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
    # Spawned, not forked: the caller may run threads (rclpy, BLAS).
    with ProcessPoolExecutor(min(jobs, len(items)), mp_context=get_context('spawn')) as pool:
        futures = {pool.submit(apply, function, item): item for item in items}
        for future in as_completed(futures):
            try:
                outcome: Outcome | None = future.result()
            except BrokenProcessPool:
                outcome = None
            yield futures[future], outcome


def _on_cluster(function: ItemFunction, items: Sequence[str], address: str) -> Stream:
    try:
        from distributed import Client, KilledWorker
        from distributed import as_completed as as_they_come
    except ImportError as error:
        raise StageError(
            '--scheduler needs Dask: pip install distributed, or leave it out to use this machine'
        ) from error
    try:
        client = Client(address, timeout=10, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        raise StageError(f'no Dask scheduler answers at {address}: check the address') from error

    def outcomes(some: Sequence[str]) -> Iterator[tuple[str, Outcome | None]]:
        """Outcomes as they come; None for items whose worker died."""
        futures = {client.submit(apply, function, item, pure=False): item for item in some}
        for future in as_they_come(list(futures), loop=client.loop):
            item = futures.pop(future)
            outcome = None
            try:
                outcome = future.result()
            except KilledWorker:
                pass
            except Exception as error:
                if future.status == 'cancelled' or client.status != 'running':
                    raise StageError(
                        f'the Dask scheduler at {address} was lost; what is done is kept: run the '
                        'command again to go on'
                    ) from error
                outcome = Outcome(item, error=f'{type(error).__name__}: {error}')
            yield item, outcome
            future.release()

    with client:
        yield from _each_alone(outcomes, items)
