"""Print the library of effects as Markdown: the table of docs/concepts/twin.md."""

from __future__ import annotations

import textwrap
from itertools import groupby

from stage_core.quantities import LINKS
from stage_twin.effects import EFFECTS, Effect, Parameter


def table() -> str:
    """Markdown of all effects, in the order of the chain."""
    lines: list[str] = []
    for link in LINKS:
        lines += [f'### {link}', '']
        for effect in EFFECTS.values():
            if effect.link == link:
                lines += _section(effect)
    return '\n'.join(lines).rstrip() + '\n'


def _family(parameter: Parameter) -> tuple[str, str, float, float]:
    """What the members of a numbered array have alike."""
    stem = parameter.name.rstrip('0123456789')
    return stem, parameter.unit, parameter.minimum, parameter.maximum


def _section(effect: Effect) -> list[str]:
    name = f'{effect.name}.x' if effect.per_axis else effect.name
    lines = [
        *textwrap.wrap(f'**`{name}`** {effect.model}', 100, break_on_hyphens=False),
        '',
        '| parameter | unit | range | when on | meaning |',
        '|---|---|---|---|---|',
    ]
    for _, group in groupby(effect.parameters, key=_family):
        first, *others = group
        last = others[-1] if others else first
        note = ' (session nuisance)' if first.nuisance else ''
        name = f'`{first.name}`' + (f' … `{last.name}`' if others else '')
        values = f'{first.when_on:g}'
        if last.when_on != first.when_on:
            values += f' … {last.when_on:g}'
        words = zip(first.meaning.split(), last.meaning.split(), strict=True)
        meaning = ' '.join(one if one == other else f'{one} … {other}' for one, other in words)
        lines.append(
            f'| {name} | {first.unit or "1"} | {first.minimum:g} to {first.maximum:g} | '
            f'{values} | {meaning}{note} |'
        )
    return [*lines, '']


if __name__ == '__main__':
    print(table(), end='')
