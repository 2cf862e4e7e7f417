"""report.json: the diagnosis in the schema gap-report/1 (docs/reference/interfaces_report.md)."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

from gap_diagnosis.evidence.judgement import Cause
from gap_diagnosis.law.judged import Law
from gap_diagnosis.report import forces
from gap_diagnosis.report.experiment import as_dict as as_entry
from gap_diagnosis.report.words import probability_words
from gap_diagnosis.result import Diagnosis
from stage_core.quantities import split_effect
from stage_core.whole_file import write_whole
from stage_core.wording import effect_words
from stage_twin.effects import EFFECTS

SCHEMA = 'gap-report/1'
MOST_CANDIDATES = 40
#: Significant digits of a number.
DIGITS = 9


def as_dict(diagnosis: Diagnosis) -> dict[str, Any]:
    """The report as plain mappings."""
    before, after = diagnosis.before, diagnosis.after
    return {
        'schema': SCHEMA,
        'session': ', '.join(diagnosis.sessions),
        'twin': diagnosis.twin_name,
        'gap': {
            'unit': 'm',
            'metric': 'rms',
            'heldout_windows': [[round(a, 6), round(b, 6)] for a, b in diagnosis.windows],
            'before': before,
            'after': after,
            'noise_floor': diagnosis.noise_floor,
            'shrink': 1.0 - after / before if before > 0.0 else 0.0,
            'channels': {
                name: {'before': c.rms('before'), 'after': c.rms('after'), 'unit': c.unit}
                for name, c in diagnosis.channels.items()
            },
        },
        'where': {
            'link': diagnosis.link,
            'axes': diagnosis.axes_share,
            'conditions': [
                {
                    'name': c.name,
                    'axis': c.axis,
                    'link': c.link,
                    'share': c.share,
                    'p_value': c.p_value,
                }
                for c in diagnosis.conditions
            ],
        },
        'causes': [_cause(c) for c in diagnosis.causes[:MOST_CANDIDATES]],
        'verdict': diagnosis.verdict,
        'unexplained': {'share': diagnosis.unexplained, 'structured': diagnosis.structured},
        'law': [_law(law) for law in diagnosis.laws],
        'noise': _noise(diagnosis),
        'warnings': diagnosis.warnings,
        'not_identifiable': forces.not_identifiable(diagnosis),
        **({'without_forces': forces.as_dict(diagnosis)} if diagnosis.drives else {}),
        **({'simulated': ', '.join(diagnosis.simulators)} if diagnosis.simulators else {}),
        **({} if diagnosis.model is None else {'model': diagnosis.model.as_dict()}),
        **({} if diagnosis.experiment is None else {'experiment': as_entry(diagnosis.experiment)}),
    }


def _law(law: Law) -> dict[str, Any]:
    return {
        'channel': law.channel,
        'kind': law.kind,
        'expression': law.expression,
        'parameters': {
            name: {'value': value, 'std': std, 'unit': unit}
            for name, (value, std, unit) in law.parameters.items()
        },
        'range': {
            name: {'low': low, 'high': high, 'unit': unit}
            for name, (low, high, unit) in law.range.items()
        },
        'unit': law.unit,
        'before': law.before,
        'after': law.after,
        'shrink': law.shrink,
        'shrink_ci95': list(law.interval),
        'effect': law.effect,
        'instead': list(law.instead),
        'gap': {'unit': 'm', 'before': law.gap[0], 'after': law.gap[1]},
    }


def _noise(diagnosis: Diagnosis) -> dict[str, Any]:
    """Measured noise of the first session: of position and effort of each axis, of the tracker."""
    record = diagnosis.records[0]
    if record.noise is None:
        return {}
    out: dict[str, Any] = {}
    for axis, own in zip(record.axes, record.noise.axes, strict=True):
        out[f'encoder.{axis}'] = {'std': own.position, 'unit': 'm'}
        if record.effort_recorded:
            out[f'effort.{axis}'] = {'std': own.effort, 'unit': 'N'}
        out[f'jitter.{axis}'] = {'std': own.jitter, 'unit': 's'}
    if record.noise.tracker is not None:
        out['tracker'] = {'std': record.noise.tracker, 'unit': 'm'}
    return out


def _cause(cause: Cause) -> dict[str, Any]:
    contains = [
        {
            'part': rung.effect,
            'supported': rung.supported,
            'shrink': rung.shrink,
            'shrink_ci95': list(rung.interval),
            'parameters': _parameters(cause.effect, rung.effect, rung.parameters),
        }
        for rung in cause.contains
    ]
    return {
        'effect': cause.effect,
        'probability': cause.probability,
        'parameters': _parameters(cause.effect, cause.effect, cause.parameters),
        'unit': cause.unit,
        'gap_before': cause.gap_before,
        'gap_after': cause.gap_after,
        'shrink': cause.shrink,
        'shrink_ci95': list(cause.interval),
        'status': cause.status,
        'alternatives': cause.alternatives,
        **({'contains': contains} if contains else {}),
    }


def _parameters(
    cause: str, effect: str, parameters: dict[str, tuple[float, float]]
) -> dict[str, dict[str, Any]]:
    units: dict[str, str] = {}
    for name in (cause, effect):
        definition = EFFECTS.get(split_effect(name)[0])
        units |= {p.name: p.unit for p in definition.parameters} if definition else {}
    return {
        name: {'value': value, 'std': _at_digits(value, std), 'unit': units.get(name, '')}
        for name, (value, std) in parameters.items()
    }


def _at_digits(value: float, std: float) -> float:
    """Standard deviation, at least what the digits of the report hold; 0 is not told."""
    return max(std, 0.5 * 10.0 ** (1 - DIGITS) * abs(value)) if std > 0.0 else std


def sentence(diagnosis: Diagnosis) -> str:
    """The verdict in one sentence, with the probability p of each effect, as commands print it."""
    micro = 1e6
    if not diagnosis.verdict:
        rests = ''
        if not diagnosis.rests_as_stated:
            rests = f', and {diagnosis.after * micro:.2f} µm with a friction that rests otherwise'
        return (
            f'no cause named: the held-out gap is {diagnosis.before * micro:.2f} µm RMS{rests} '
            f'(floor {diagnosis.noise_floor * micro:.2f} µm)'
        )
    sure = {cause.effect: cause.probability for cause in diagnosis.causes}
    names = ', '.join(
        effect_words(name) + (f' (p {probability_words(sure[name])})' if name in sure else '')
        for name in diagnosis.verdict
    )
    if round(100.0 * diagnosis.shrink) == 0:
        return (
            f'{names}: the held-out gap stays at {diagnosis.after * micro:.2f} µm RMS (floor '
            f'{diagnosis.noise_floor * micro:.2f} µm)'
        )
    way = 'shrinks' if diagnosis.shrink > 0.0 else 'grows'
    return (
        f'{names}: the held-out gap {way} from {diagnosis.before * micro:.2f} to '
        f'{diagnosis.after * micro:.2f} µm RMS ({100.0 * abs(diagnosis.shrink):.0f} %, floor '
        f'{diagnosis.noise_floor * micro:.2f} µm)'
    )


def write(diagnosis: Diagnosis, directory: Path) -> Path:
    """Write report.json and the corrected twin; returns the report's path."""
    directory.mkdir(parents=True, exist_ok=True)
    diagnosis.corrected_twin.save(directory / 'corrected_twin.yaml')
    path = directory / 'report.json'
    text = json.dumps(_finite(as_dict(diagnosis)), indent=2, allow_nan=False)
    write_whole(path, text + '\n')
    return path


def _finite(value: Any) -> Any:
    """JSON knows no NaN: a number that is not finite becomes null."""
    if isinstance(value, dict):
        return {k: _finite(v) for k, v in value.items()}
    if isinstance(value, list):
        return [_finite(v) for v in value]
    if isinstance(value, float):
        return float(f'{value:.{DIGITS}g}') if math.isfinite(value) else None
    return value
