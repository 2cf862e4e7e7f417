"""Training samples of bags: of one, of several, or of an archive of hundreds."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from calibrator.prepare import prepare, require_rests
from calibrator.samples import Gathered, Samples, concatenate
from calibrator.training import twin_leads
from session_bags.archive import ItemFunction, Where, find_bags, is_bag, map_bags
from session_bags.reader import read_session
from stage_core import topics
from stage_core.errors import StageError
from stage_core.session import Session


def gather(
    paths: Sequence[str],
    source: str,
    target: str,
    results: str | Path = '',
    where: Where | None = None,
) -> Gathered:
    """Samples of the bags that paths name, each a bag or a folder of bags.

    A bag that is named must give samples; one that is found in a folder is skipped where it
    does not. What was measured once is taken once, however many bags hold it.

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
        bags = find_bags(path)
        if is_bag(path):
            given.append((bags[0], work(str(bags[0]))))
            continue
        for bag, (result, error) in zip(
            bags, _each(work, bags, f'samples/3 {source} {target}', results, where), strict=True
        ):
            if error:
                skipped[str(bag)] = error
            else:
                given.append((bag, result))
    if not given:
        name, reason = next(iter(skipped.items()))
        raise StageError(f'no bag gives training samples; {name}, for one: {reason}')
    parts: dict[Path, Samples] = {}
    for bag, content in given:
        part = Samples.from_dict(content['samples'])
        # A copy, or the bag beside its repaired one, would vouch for itself as another session.
        if twins := [other for other, samples in parts.items() if samples.holds(part)]:
            skipped[str(bag)] = f'it holds the same measurements as {twins[0]}'
        else:
            parts[bag] = part
    return Gathered(concatenate(list(parts.values())), given[0][1]['leads'], list(parts), skipped)


def bag_samples(bag: str, source: str, target: str) -> dict[str, Any]:
    """Samples of one bag as JSON can hold them (numbers keep every bit), and its screw leads."""
    session = read_training_session(bag, source, target)
    samples = prepare(session, source, target)
    require_rests(samples, target)
    return {'samples': samples.to_dict(), 'leads': twin_leads(session)}


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
