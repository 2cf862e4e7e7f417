"""Writes what cheap commands print into the pages that show it: part of ``make docs-figures``.

A page marks the place by ``<!-- prints COMMAND -->`` and ``<!-- end -->``. It is run in the
folder of the repository; ``the code above`` stands for the page's last block of Python.
``tests/test_figures.py`` compares these places with their commands.
"""

from __future__ import annotations

import contextlib
import io
import re
import runpy
import shlex
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from unittest import mock

ROOT = Path(__file__).resolve().parents[1]
PLACE = re.compile(r'(<!-- prints (.+?) -->\n)(.*?)(\n<!-- end -->)', re.DOTALL)
CODE = re.compile(r'^```python\n(.*?)^```', re.DOTALL | re.M)


def places() -> Iterator[tuple[Path, re.Match[str]]]:
    """Page and match (start, command, shown text, end) of each place."""
    for page in sorted((ROOT / 'docs').rglob('*.md')):
        for found in PLACE.finditer(page.read_text(encoding='utf-8')):
            yield page, found


def printed(found: re.Match[str]) -> str:
    """What the command of a place prints now, as a page shows it."""
    command, *filters = found[2].split(' | ', 1)
    with contextlib.redirect_stdout(io.StringIO()) as output:
        if command == 'the code above':
            *_, code = CODE.findall(found.string[: found.start()])
            exec(code, {'__name__': '__main__'})
        elif command.startswith('python '):
            _python(shlex.split(command)[1:])
        else:
            print(_shell(command))
    text = output.getvalue().strip('\n')
    text = _shell(filters[0], text) if filters else text
    return text if text.startswith('|') else f'```\n{text}\n```'


def _python(words: list[str]) -> None:
    """Run a module or a file in this process: its imports serve the next command too."""
    module = words[0] == '-m'
    run, words = (runpy.run_module, words[1:]) if module else (runpy.run_path, words)
    name = words[0] if module else str(ROOT / words[0])
    # A file may import its neighbours.
    path = [str(Path(name).parent), *sys.path]
    with (
        mock.patch.object(sys, 'argv', words),
        mock.patch.object(sys, 'path', path),
        contextlib.suppress(SystemExit),
    ):
        run(name, run_name='__main__')


def _shell(command: str, text: str = '') -> str:
    done = subprocess.run(
        command, shell=True, check=True, cwd=ROOT, input=text, stdout=subprocess.PIPE, text=True
    )
    return done.stdout.strip('\n')


def main() -> None:
    """Write every place."""
    for page, found in list(places()):
        text = found[1] + printed(found) + found[4]
        page.write_text(page.read_text(encoding='utf-8').replace(found[0], text), encoding='utf-8')
        print(f'{page.relative_to(ROOT)}: {found[2]}', flush=True)


if __name__ == '__main__':
    main()
