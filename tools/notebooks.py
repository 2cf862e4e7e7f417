"""Runs the tutorials and writes their pages with what they print and draw: ``make tutorials``.

A tutorial is a Python file of cells (``# %%``), which Jupyter opens as a notebook with jupytext. A
figure at the end of a cell becomes a picture of the page.
"""

from __future__ import annotations

import argparse
import ast
import contextlib
import io
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from stage_bringup.provenance import provenance

ROOT = Path(__file__).resolve().parents[1]
TUTORIALS = ROOT / 'docs' / 'guide' / 'tutorials'
MARK = '# %%'


def cells(source: str) -> Iterator[tuple[str, str]]:
    """Kind (`markdown`, `code`) and text of each cell of a file."""
    for part in ('\n' + source).split('\n' + MARK)[1:]:
        title, _, body = part.partition('\n')
        if title.strip() == '[markdown]':
            lines = [line.removeprefix('#').removeprefix(' ') for line in body.splitlines()]
            yield 'markdown', '\n'.join(lines).strip()
        else:
            yield 'code', body.strip()


def run_cell(code: str, names: dict[str, Any]) -> tuple[str, Any]:
    """Run a cell; what it prints, and the value of its last line."""
    tree = ast.parse(code)
    last = tree.body[-1] if tree.body else None
    value = None
    if isinstance(last, ast.Expr):
        tree.body.pop()
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        exec(compile(tree, '<cell>', 'exec'), names)
        if isinstance(last, ast.Expr):
            value = eval(compile(ast.Expression(last.value), '<cell>', 'eval'), names)
    return printed.getvalue().rstrip(), value


def page(tutorial: Path, images: Path, folder: Path) -> str:
    """Text of a tutorial's page in `folder`; its pictures go to `images`."""
    names: dict[str, Any] = {'__name__': tutorial.stem}
    parts, number = [], 0
    for kind, text in cells(tutorial.read_text(encoding='utf-8')):
        if kind == 'markdown':
            parts.append(text)
            continue
        parts.append(f'```python\n{text}\n```')
        printed, value = run_cell(text, names)
        if printed:
            parts.append(f'```\n{printed}\n```')
        if isinstance(value, Figure):
            number += 1
            picture = images / f'tutorial_{tutorial.stem}_{number}.webp'
            value.savefig(picture, dpi=90, facecolor='white', pil_kwargs={'quality': 70})
            place = Path(*['..'] * len(folder.relative_to(images.parent).parts), images.name)
            parts.append(f'![{tutorial.stem}, picture {number}]({place / picture.name})')
    return '\n\n'.join(parts) + '\n'


def source(tutorial: Path) -> str:
    """The sentence that says which state of the code a page is of."""
    state = provenance(Path(__file__).resolve())
    changes = ' with changes' if state.get('changed') else ''
    commit = f', commit {state["commit"]}{changes}' if 'commit' in state else ''
    made = f'{state["recorded"][:10]}{commit}'
    return f'*Written by `make tutorials` from [{tutorial.name}]({tutorial.name}),\n{made}.*'


def write(tutorial: Path, docs: Path, said: str = '') -> Path:
    """Run a tutorial and write its page, with `said` at its end, and pictures below `docs`."""
    folder, images = docs / 'guide' / 'tutorials', docs / 'images'
    for place in (folder, images):
        place.mkdir(parents=True, exist_ok=True)
    written = folder / f'{tutorial.stem}.md'
    written.write_text(page(tutorial, images, folder) + said, encoding='utf-8')
    return written


def main() -> None:
    """Run all tutorials, or those named."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('names', nargs='*', help='tutorials without their ending; default all')
    parser.add_argument('--docs', type=Path, default=ROOT / 'docs', help='where the pages go')
    given = parser.parse_args()
    chosen = [t for t in sorted(TUTORIALS.glob('*.py')) if t.stem in (given.names or [t.stem])]
    # The first page that is written changes the state.
    for tutorial, said in [(tutorial, f'\n{source(tutorial)}\n') for tutorial in chosen]:
        print(write(tutorial, given.docs.resolve(), said), flush=True)


if __name__ == '__main__':
    main()
