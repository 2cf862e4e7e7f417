"""Diagnoses the sessions and keeps what each gives to the fit, for one state of the code."""

from __future__ import annotations

import functools
import hashlib
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

from benchmarks.calibrate.sessions import Sample, samples
from benchmarks.calibrate.truth import in_report_terms
from benchmarks.generators.score import judged
from gap_diagnosis.diagnose import diagnose
from gap_diagnosis.evidence.judgement import Cause
from gap_diagnosis.evidence.probability import kind_of
from gap_diagnosis.report.document import as_dict
from gap_diagnosis.result import Diagnosis
from session_bags.archive import Where, map_items
from stage_core.errors import StageError

ROOT = Path(__file__).resolve().parents[2]
CODE = (
    'src/gap_diagnosis/gap_diagnosis',
    'src/stage_twin/stage_twin',
    'benchmarks/blind',
    'benchmarks/generators',
    'benchmarks/calibrate/sessions.py',
    'benchmarks/calibrate/truth.py',
)
#: Written by the fit: what a session gives does not depend on it.
FITTED = 'calibrated.py'

Row = dict[str, Any]
NOTHING: Row = {'statements': [], 'structure': []}


def code_hash() -> str:
    """Changes with the diagnosis, the twin and the generators; not with what is fitted."""
    files = [p for name in CODE for p in ([ROOT / name] if name[-3:] == '.py' else _below(name))]
    digest = hashlib.sha256()
    for path in files:
        digest.update(str(path.relative_to(ROOT)).encode() + path.read_bytes())
    return digest.hexdigest()[:12]


def _below(folder: str) -> list[Path]:
    return [p for p in sorted((ROOT / folder).rglob('*.py')) if p.name != FITTED]


def collect(items: list[str], kept: Path, where: Where) -> tuple[list[Row], list[str]]:
    """Diagnose the seeds that lack; rows of all sessions that are kept, and what failed."""
    function = functools.partial(keep_rows, kept=str(kept))
    outcomes = map_items(function, items, kept / 'seeds', where=where)
    rows = [json.loads(path.read_text()) for path in sorted(kept.glob('*/*_*.json'))]
    return rows, [f'{o.item}: {o.error}' for o in outcomes if o.error]


def keep_rows(item: str, kept: str) -> int:
    """Keep what each session of a generator's seed (`mujoco-7`) gives to the fit; their number."""
    generator, seed = item.split('-')
    folder = Path(kept) / generator
    folder.mkdir(parents=True, exist_ok=True)
    count = 0
    for one in samples(generator, int(seed)):
        path = folder / f'{seed}_{count}.json'
        if not path.exists():
            row = {'generator': generator, 'seed': int(seed), **_row(one)}
            path.with_suffix('.tmp').write_text(json.dumps(row))
            path.with_suffix('.tmp').rename(path)
        count += 1
    return count


def _row(one: Sample) -> Row:
    """The verdict as the generators' scorer judges it, and the features of each statement."""
    truth = in_report_terms(one.truth, one.twin)
    also = {'also_right': truth['also_right'], 'planted': truth['planted']}
    try:
        found = diagnose([one.session], [], one.twin)
    except StageError as error:
        return {**judged(one.name, truth, None, ' '.join(str(error).split())), **also, **NOTHING}
    report = as_dict(replace(found, causes=[_as_estimated(c, found) for c in found.causes]))
    return {
        **judged(one.name, truth, report),
        **also,
        'statements': _statements(found, truth),
        'structure': [
            [p.name, p.structure.share, p.structure.mean_square / p.problem.floor**2]
            for p in found.parts
        ],
    }


def _as_estimated(cause: Cause, found: Diagnosis) -> Cause:
    """A cause whose deviations are not yet widened by an earlier fit."""
    return replace(cause, parameters=found.parameters.get(cause.effect, {}))


def _statements(found: Diagnosis, truth: Row) -> list[Row]:
    """Each cause: kind, whether it is true, its features, its parameters.

    A named effect is true where any right verdict holds it; one that was passed over where the
    truth itself does.
    """
    wanted = set(truth['truth'])
    right = wanted.union(*truth['also_right'])
    rows = []
    for cause in found.causes:
        kind = kind_of(cause)
        among = right if kind == 'named' else wanted
        true = not wanted if cause.effect == 'none' else cause.effect in among
        rows.append({'effect': cause.effect, 'kind': kind, 'true': true, **_measured(cause, kind)})
    return rows


def _measured(cause: Cause, kind: str) -> Row:
    parameters = cause.parameters if kind == 'named' else {}
    return {
        'features': {n: round(v, 4) for n, v in cause.features.items() if v},
        'parameters': {n: [float(v) for v in pair] for n, pair in parameters.items()},
    }
