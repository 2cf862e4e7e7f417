"""Section of the page about what the remainder is a function of."""

from __future__ import annotations

from matplotlib.figure import Figure

from gap_diagnosis.law.judged import Law
from gap_diagnosis.result import Diagnosis
from stage_core.arrays import Array
from stage_core.drawing import canvas, styled
from stage_core.pages import Page
from stage_core.theme import BLUE, ORANGE
from stage_core.wording import effect_words, measure, scaled, span, with_std
from stage_twin.effects.law_terms import VARIABLES

#: What the letters and words of an expression mean; a page explains those that it uses.
_WORDS = {name: words for name, (_, _, words) in VARIABLES.items()} | {
    'a': 'acceleration of the axis'
}
MOST_PARAMETERS = 14


def laws_section(page: Page, diagnosis: Diagnosis) -> None:
    """The equation of every remainder, where it was seen and what it closes."""
    if not diagnosis.structured and not diagnosis.laws:
        return
    page.heading('What the remainder is a function of')
    if not diagnosis.laws:
        page.text(
            'Structure remains, and neither an equation in position, speed, direction, force, '
            'time, temperature and the other axis nor a smooth curve over one of them explains '
            'it on data that no fit has seen. It is a vibration, a delay or something hidden.'
        )
    for law in diagnosis.laws:
        _law(page, law)


def _law(page: Page, law: Law) -> None:
    kind, _, axis = law.channel.partition('.')
    what = f'force on {axis}' if kind == 'force' else f'error of {axis}'
    page.subheading(f'{what} = {law.expression}')
    low, high = law.interval
    words = ', '.join(f'{name} is the {_WORDS[name]}' for name in law.range)
    letters = f'Here {words}. ' if words else ''
    used = (
        'The corrected twin holds it'
        if law.runs
        else 'The corrected twin leaves it out, as it follows the machine no better with it'
    )
    page.text(
        f'{"A smooth curve, no equation" if law.kind == "map" else "An equation"} that closes '
        f'{100 * law.shrink:.0f} % (95 %: {span(100 * low, 100 * high, "%")}) of what the '
        f'named effects leave of the {kind}: {measure(law.before, law.unit)} → '
        f'{measure(law.after, law.unit)} RMS, on data that no fit has seen. {letters}'
        f'{used} (`{law.effect}`): gap {measure(law.gap[0])} → {measure(law.gap[1])} RMS.'
    )
    if law.instead:
        page.text(
            f'It stands in the place of {", ".join(law.instead)} and explains more than with '
            'them. Do not trust these names.'
        )
    seen = [[n, *(measure(v, u) for v in (lo, hi))] for n, (lo, hi, u) in law.range.items()]
    if seen:
        page.table(['seen for', 'from', 'to'], seen, 'beyond this range the law is a guess')
    if law.kind == 'law':
        page.table(
            ['parameter', 'value ± 1 σ'],
            [
                [name, with_std(value, std, unit)]
                for name, (value, std, unit) in list(law.parameters.items())[:MOST_PARAMETERS]
            ],
        )
    page.figure(
        picture(law),
        f'Remaining {what} and the law',
        'Blue should lie in the middle of orange everywhere.',
    )


@styled
def picture(law: Law) -> Figure:
    """Remainder and law over the law's first variable, held-out rows."""
    name, x, remainder, fitted = law.picture
    figure = canvas(10.5, 3.2)
    plot = figure.subplots()
    along, across = (
        _factor(x, VARIABLES[name][1] if name in VARIABLES else 'm/s^2'),
        _factor(remainder, law.unit),
    )
    plot.plot(along[0] * x, across[0] * remainder, '.', ms=2.0, color=ORANGE, label='remainder')
    plot.plot(along[0] * x, across[0] * fitted, '.', ms=2.0, color=BLUE, label='law')
    plot.set(
        xlabel=f'{_WORDS[name]} ({along[1]})',
        ylabel=f'remaining {effect_words(law.channel)} ({across[1]})',
    )
    plot.legend()
    return figure


def _factor(values: Array, unit: str) -> tuple[float, str]:
    return scaled(float(abs(values).max()), unit)
