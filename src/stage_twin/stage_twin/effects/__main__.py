"""Print the library of effects as Markdown: the table of docs/twin.md."""

from __future__ import annotations

from stage_core.quantities import LINKS
from stage_twin.effects import EFFECTS, Effect


def table() -> str:
    """Markdown of all effects, in the order of the chain."""
    lines: list[str] = []
    for link in LINKS:
        lines += [f'### {link}', '']
        for effect in EFFECTS.values():
            if effect.link == link:
                lines += _section(effect)
    return '\n'.join(lines).rstrip() + '\n'


def _section(effect: Effect) -> list[str]:
    name = f'{effect.name}.x' if effect.per_axis else effect.name
    lines = [
        f'**`{name}`** {effect.model}',
        '',
        '| parameter | unit | range | when on | meaning |',
        '|---|---|---|---|---|',
    ]
    for parameter in effect.parameters:
        note = ' (session nuisance)' if parameter.nuisance else ''
        lines.append(
            f'| `{parameter.name}` | {parameter.unit or "1"} | {parameter.minimum:g} to '
            f'{parameter.maximum:g} | {parameter.when_on:g} | '
            f'{parameter.meaning}{note} |'
        )
    return [*lines, '']


if __name__ == '__main__':
    print(table(), end='')
