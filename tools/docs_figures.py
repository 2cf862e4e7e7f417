"""Writes the figures of a session into README and docs: ``make docs-figures``.

Takes the newest session of bags/ (or the one that is named) and replaces what stands between the
marks ``<!-- session -->`` and ``<!-- end -->``, and its picture in docs/images.
"""

from __future__ import annotations

import json
import re
import shutil
import sys
import textwrap
from pathlib import Path

import numpy as np

from stage_bringup.table import heldout_rows
from stage_core.twin_file import TwinFile
from stage_core.wording import effect_words, parameter_name, scaled, with_std
from stage_twin.effects import effect_of

ROOT = Path(__file__).resolve().parents[1]
#: Pages of the guide with a line that the session prints, and the step that it is of.
STEPS = {
    'calibrate.md': 'calibrator',
    'follow_contour.md': 'circle',
    'diagnose.md': 'diagnosis',
    'tutorials/paper3.md': 'circle',
}


def replace(page: Path, text: str) -> None:
    """Put text between the marks of a page."""
    old = page.read_text(encoding='utf-8')
    new, count = re.subn(
        r'<!-- session -->.*?<!-- end -->',
        lambda _: f'<!-- session -->\n{text}\n<!-- end -->',
        old,
        flags=re.DOTALL,
    )
    if count != 1:
        raise SystemExit(f'{page} has {count} places for a session: it needs one')
    page.write_text(new, encoding='utf-8')


def printed(folder: Path) -> str:
    """The table that the session printed, as a code block."""
    heldout = json.loads((folder / 'session.json').read_text())['heldout']
    rows = heldout_rows(*(np.array(heldout[f'errors_{w}']) for w in ('before', 'after')))
    # MAE and σ are in the pages: the README shows what fits a line.
    lines = [f'{"error [µm]":<20}' + ''.join(f'{name:>13}' for name in
             ('RMS before', 'max before', 'RMS after', 'max after'))]  # fmt: skip
    for row in rows:
        values = (row.before.rms, row.before.max, row.after.rms, row.after.max)
        lines.append(f'{row.name:<20}' + ''.join(f'{1e6 * v:>13.2f}' for v in values))
    return f'{_code(lines)}\n\n{said(folder, "diagnosis")}'


def said(folder: Path, step: str) -> str:
    """The line that the session printed of a step, as a code block."""
    lines = json.loads((folder / 'session.json').read_text())['lines']
    (line,) = (text for text in lines if text.startswith(f'{step}: '))
    if step != 'diagnosis':
        line = line.removeprefix(f'{step}: ')
    # A number and its unit or name stay in one line.
    line = line.replace(' µm', '\u00a0µm').replace('(p ', '(p\u00a0')
    wrapped = textwrap.wrap(line, 92, subsequent_indent='  ')
    return _code([part.replace('\u00a0', ' ') for part in wrapped])


def _code(lines: list[str]) -> str:
    return '\n'.join(f'    {line}'.rstrip() for line in lines)


def planted() -> dict[tuple[str, str], str]:
    """What the emulated machine of a session has, by effect and parameter, as a reader says it."""
    out = {}
    machine = TwinFile.load(ROOT / 'ros_ws' / 'config' / 'twin_reality.yaml')
    for effect, values in machine.effects.items():
        for name, value in values.items():
            factor, symbol = scaled(value, effect_of(effect).parameter(name).unit)
            out[effect_words(effect), parameter_name(name)] = f'{factor * value:g} {symbol}'
    return out


def example(folder: Path) -> str:
    """What was planted in the emulated machine and what was found."""
    given = planted()
    report = json.loads((folder / 'diagnosis' / 'report.json').read_text())
    lines = ['| effect | parameter | planted | found |', '|---|---|---|---|']
    for cause in report['causes']:
        effect = cause['effect']
        if effect in report['verdict']:
            for name, found in cause['parameters'].items():
                value = with_std(found['value'], found['std'], found['unit'])
                words = (effect_words(effect), parameter_name(name))
                row = [*words, given.get(words, 'not planted'), value]
                lines.append(f'| {" | ".join(row)} |')
    return '\n'.join(lines)


def source(folder: Path) -> str:
    """The sentence that says which session the figures are of."""
    session = json.loads((folder / 'session.json').read_text())
    changes = ' with changes' if session['changed'] else ''
    state = f'{session["recorded"][:10]}, commit {session["commit"]}{changes}'
    tests = ' with `--standard-tests`' if (folder / 'positioning').exists() else ''
    return textwrap.fill(f'Written by `make docs-figures` from a session{tests} of {state}.', 100)


def main() -> None:
    """Write everything that comes from one session."""
    sessions = sorted((ROOT / 'bags').glob('*/session.json'), key=lambda p: p.stat().st_mtime)
    named = Path(sys.argv[1]).resolve() if len(sys.argv) > 1 else None
    if named is None and not sessions:
        raise SystemExit('bags/ holds no session: run make session first')
    folder = named or sessions[-1].parent
    said_by = f'\n\n{source(folder)}'
    replace(ROOT / 'README.md', printed(folder) + said_by)
    guide = ROOT / 'docs' / 'guide'
    steps = json.loads((folder / 'session.json').read_text())['steps']
    replace(guide / 'start.md', _code(steps) + said_by)
    replace(guide / 'diagnosis_reading.md', example(folder) + said_by)
    for page, step in STEPS.items():
        replace(guide / page, said(folder, step) + said_by)
    images = ROOT / 'docs' / 'images'
    shutil.copyfile(folder / 'picture_01.png', images / 'session.png')
    print(f'figures of {folder.name} are in README.md and docs/')


if __name__ == '__main__':
    main()
