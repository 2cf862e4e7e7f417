"""Settings of the site that `make site` builds from README.md, docs and the packages' READMEs."""

from __future__ import annotations

import re
from pathlib import Path

from sphinx.application import Sphinx

ROOT = Path(__file__).resolve().parents[2]
INDEX = ROOT / 'docs' / 'README.md'
#: What the side bar has below the sections of the index.
OTHERS = {'Packages': 'src/**/README', 'Project': '*\n*/README\nbenchmarks/**/README'}

project = 'Precision XY stages'
copyright = 'the maintainers, Apache-2.0'
extensions = ['myst_parser']
root_doc = 'README'
include_patterns = [
    '*.md',
    'docs/README.md',
    'docs/**/*.md',
    'src/**/README.md',
    'ros_ws/README.md',
    'benchmarks/**/README.md',
]
exclude_patterns = ['.venv/**', 'build/**']
html_theme = 'furo'
html_title = project
myst_heading_anchors = 4
suppress_warnings = ['myst.header']
highlight_language = 'none'


def contents() -> str:
    """The side bar: the sections and pages of docs/README.md, in its order."""
    parts = []
    for section in re.split(r'^## ', INDEX.read_text(encoding='utf-8'), flags=re.M)[1:]:
        pages = re.findall(r'\]\(([\w/]+)\.md\)', section)
        listed = '\n'.join(f'docs/{page}' for page in dict.fromkeys(pages))
        caption = section.partition('\n')[0]
        parts.append(f'```{{toctree}}\n:hidden:\n:caption: {caption}\n\n{listed}\n```\n')
    for caption, files in OTHERS.items():
        parts.append(f'```{{toctree}}\n:hidden:\n:glob:\n:caption: {caption}\n\n{files}\n```\n')
    return '\n'.join(parts)


def _read(app: Sphinx, name: str, source: list[str]) -> None:
    if name == root_doc:
        source[0] += f'\n{contents()}'


def setup(app: Sphinx) -> None:
    """Add the side bar to the first page."""
    app.connect('source-read', _read)
