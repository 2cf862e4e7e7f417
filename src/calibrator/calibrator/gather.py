"""Training samples of bags: of one, of several, or of an archive of hundreds."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from calibrator.prepare import prepare
from calibrator.samples import Samples, concatenate
from calibrator.training import find_bags, twin_leads
from session_bags.archive import ItemFunction, Where, is_bag, map_bags
from session_bags.reader import read_session
from stage_core import topics
from stage_core.errors import StageError
from stage_core.session import Session

ARRAYS = ('command', 'measured', 'direction', 'temperatures', 'times', 'rates', 'session')
"""The arrays of `Samples`, of which a short session has no rates and one alone no number."""


@dataclass(frozen=True)
class Gathered:
    """Samples of all bags together.

    Attributes
    ----------
    samples
        In the order of the bags.
    leads
        Lead of each axis' screw [m] from the first bag's nominal twin, None where it has none.
    bags
        Those that the samples came from.
    skipped
        Bags of an archive that gave none, each with the reason.
    """

    samples: Samples
    leads: list[float] | None
    bags: list[Path]
    skipped: dict[str, str]


def gather(
    paths: Sequence[str],
    source: str,
    target: str,
    results: str | Path = '',
    where: Where | None = None,
) -> Gathered:
    """Samples of the bags that paths name, each a bag or a folder of bags.

    A bag that is named must give samples; one that is found in a folder is skipped where it
    does not.

    Parameters
    ----------
    source, target
        As of `prepare.prepare`.
    results
        Folder that keeps what each bag of a folder gave, so that an interrupted run goes on.
        Where it is empty, bags are read one after the other and nothing is kept.
    where
        Processes or cluster to read the bags of a folder with.

    Raises
    ------
    StageError
        If a path names no bag, a named bag gives no samples, or no bag of a folder does.
    """
    work = functools.partial(bag_samples, source=source, target=target)
    given: list[tuple[Path, dict[str, Any]]] = []
    skipped: dict[str, str] = {}
    for path in paths:
        bags = find_bags([path])
        if is_bag(path):
            given.append((bags[0], work(str(bags[0]))))
            continue
        for bag, (result, error) in zip(
            bags, _each(work, bags, f'{source} {target}', results, where), strict=True
        ):
            if error:
                skipped[str(bag)] = error
            else:
                given.append((bag, result))
    if not given:
        name, reason = next(iter(skipped.items()))
        raise StageError(f'no bag gives training samples; {name}, for one: {reason}')
    parts = [_from_json(content) for _, content in given]
    return Gathered(concatenate(parts), given[0][1]['leads'], [bag for bag, _ in given], skipped)


def bag_samples(bag: str, source: str, target: str) -> dict[str, Any]:
    """Samples of one bag as JSON can hold them (numbers keep every bit), and its screw leads."""
    session = read_training_session(bag, source, target)
    content = asdict(prepare(session, source, target))
    for name in ARRAYS:
        content[name] = None if content[name] is None else content[name].tolist()
    return {'samples': content, 'leads': twin_leads(session)}


def read_training_session(bag: str | Path, source: str, target: str) -> Session:
    """Session of a bag, with only the topics that a training reads."""
    wanted = {topics.REFERENCE, topics.TEMPERATURE}
    if 'encoder' in (source, target):
        wanted.add(topics.JOINT_STATES)
    if target == 'tracker':
        # The clock shift of a stepper is judged by its counted travel.
        wanted |= {topics.TRACKER_POINT, topics.JOINT_STATES}
    return read_session(bag, wanted)


def _each(
    work: ItemFunction, bags: list[Path], settings: str, results: str | Path, where: Where | None
) -> list[tuple[Any, str]]:
    """Result and error of every bag."""
    if results:
        return [(o.result, o.error) for o in map_bags(work, bags, results, settings, where)]
    found: list[tuple[Any, str]] = []
    for bag in bags:
        try:
            found.append((work(str(bag)), ''))
        except StageError as error:
            found.append((None, str(error)))
    return found


def _from_json(content: dict[str, Any]) -> Samples:
    fields = dict(content['samples'])
    axes, sensors = tuple(fields['axes']), tuple(fields['sensors'])
    for name in ARRAYS:
        if fields[name] is not None:
            fields[name] = np.asarray(fields[name], np.float64)
    # An array without columns has lost its shape.
    fields['temperatures'] = fields['temperatures'].reshape(len(fields['times']), len(sensors))
    return Samples(**{**fields, 'axes': axes, 'sensors': sensors})
