"""Sections of the page about the causes: what was found, the evidence, what an effect contains."""

from __future__ import annotations

from collections.abc import Sequence

from gap_diagnosis.evidence.describe import not_seen
from gap_diagnosis.evidence.judgement import NONE, Cause
from gap_diagnosis.parameters import Estimates
from gap_diagnosis.report.words import probability_words, status_words
from gap_diagnosis.result import Diagnosis
from stage_core.metrics import SIGMAS
from stage_core.pages import Page
from stage_core.quantities import UNKNOWN, split_effect
from stage_core.wording import effect_words, parameter_name, rounded, span, with_std
from stage_twin.effects import EFFECTS, effect_of

#: The table of the evidence has a row for each candidate of this probability or more.
LIKELY = 0.01
#: Caption of a table with what each effect closes.
CLOSES = (
    'closes: by how much the gap is smaller than without this effect, beside all others; the '
    'shares do not add up to 100 %'
)


def parameter_words(effect: str, parameters: Estimates) -> str:
    """*width 7.98 ± 0.05 µm*, for each parameter of an effect."""
    definition = EFFECTS.get(split_effect(effect)[0])
    units = {p.name: p.unit for p in definition.parameters} if definition else {}
    unseen = not_seen(effect, parameters) if definition else []
    return ', '.join(
        f'{parameter_name(name)} not seen'
        if name in unseen
        else f'{parameter_name(name)} {with_std(value, std, units.get(name, ""))}'
        for name, (value, std) in parameters.items()
    )


def effect_sentence(effect: str, parameters: Estimates) -> str:
    """What a machine with this effect does, its values to the digits that are known.

    A value whose 95 % interval holds zero is said to be none. One that belongs to the session
    alone, such as an offset, is named where its interval excludes zero.
    """
    definition = effect_of(effect)
    known = {name: rounded(value, std) for name, (value, std) in parameters.items()}
    unsure = [
        name
        for name, (value, std) in parameters.items()
        if f'{{{name}}}' in definition.sentence
        and definition.parameter(name).neutral == 0.0
        and abs(value) < SIGMAS * std
    ]
    beside = {
        p.name: parameters[p.name]
        for p in definition.parameters
        if p.nuisance
        and p.fitted
        and p.neutral == 0.0
        and p.name in parameters
        and abs(parameters[p.name][0]) >= SIGMAS * parameters[p.name][1]
    }
    said = [f'the {parameter_name(name)} may be zero' for name in unsure]
    unseen = [parameter_name(name) for name in not_seen(effect, parameters)]
    said += [f'not seen: {", ".join(unseen)}'] if unseen else []
    said += [f'with {words}' for words in [parameter_words(effect, beside)] if words]
    return '; '.join([definition.says(known), *said])


def closes_words(shrink: float, interval: Sequence[float]) -> str:
    """What an effect closes of the gap, with its interval: *53 % (42 to 62 %)*."""
    low, high = (100.0 * value for value in interval)
    return f'{100 * shrink:.0f} % ({span(low, high, "%")})'


def _accepted(cause: Cause) -> bool:
    return cause.status == 'accepted' and bool(cause.parameters)


def found_section(page: Page, diagnosis: Diagnosis) -> None:
    """What each accepted effect means on this machine."""
    rows: list[list[object]] = []
    for cause in diagnosis.causes:
        if not _accepted(cause):
            continue
        rows.append(
            [
                effect_words(cause.effect),
                effect_sentence(cause.effect, cause.parameters),
                parameter_words(cause.effect, cause.parameters),
                closes_words(cause.shrink, cause.interval),
            ]
        )
    if rows:
        page.heading('What was found')
        page.table(['effect', 'what it does', 'parameters ± 1 σ', 'closes (95 %)'], rows, CLOSES)


def causes_section(page: Page, diagnosis: Diagnosis) -> None:
    """The candidates that are likely or measured with their evidence, and the names of others."""
    shown = [c for c in diagnosis.causes if c.parameters or c.probability >= LIKELY]
    page.heading('Evidence for each candidate')
    page.text(
        'The probability says how often such a statement is right about simulated machines '
        'whose effects are known. '
        '"Cannot be told from" names rivals that these data do not separate.'
    )
    if shown:
        page.table(
            ['effect', 'probability', 'result', 'parameters ± 1 σ', 'closes (95 %)',
             'cannot be told from'],
            [
                [
                    effect_words(cause.effect),
                    probability_words(cause.probability),
                    status_words(cause.status),
                    parameter_words(cause.effect, cause.parameters),
                    closes_words(cause.shrink, cause.interval) if _accepted(cause) else '',
                    ', '.join(effect_words(name) for name in cause.alternatives),
                ]
                for cause in shown
            ],
            'twin files and `report.json` write `backlash.x` for backlash of x',
        )  # fmt: skip
    effects = [c for c in diagnosis.causes if c.effect not in (UNKNOWN, NONE)]
    _others(page, [c for c in effects if c not in shown])


def _others(page: Page, causes: list[Cause]) -> None:
    """The unlikely candidates by what became of them."""
    named: dict[str, list[str]] = {}
    for cause in causes:
        named.setdefault(status_words(cause.status), []).append(effect_words(cause.effect))
    if named:
        page.text(f'The other candidates have a probability below {LIKELY:.2f}:')
        page.items([f'{status}: {", ".join(names)}.' for status, names in named.items()])


def contained_section(page: Page, diagnosis: Diagnosis) -> None:
    """What effects that hold special cases are made of."""
    for cause in diagnosis.causes:
        if not cause.contains:
            continue
        page.subheading(f'What {effect_words(cause.effect)} contains, added one by one')
        page.table(
            ['part', 'shrinks the rest by (95 %)', 'seen', 'parameters ± 1 σ'],
            [
                [
                    effect_words(rung.effect),
                    closes_words(rung.shrink, rung.interval),
                    'yes' if rung.supported else 'no',
                    parameter_words(rung.effect, rung.parameters)
                    or parameter_words(cause.effect, rung.parameters),
                ]
                for rung in cause.contains
            ],
        )
