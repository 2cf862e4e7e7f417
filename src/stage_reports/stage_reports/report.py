"""A self-contained HTML page: text, tables and pictures in one file that loads nothing."""

from __future__ import annotations

import base64
import html
import io
from collections.abc import Sequence
from pathlib import Path

from matplotlib.figure import Figure

from stage_core.errors import StageError

STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; color: #1c1c1c; background: #fff;
       max-width: 62rem; margin: 2rem auto; padding: 0 1rem; }
h1 { font-size: 1.7rem; } h2 { font-size: 1.25rem; margin-top: 2rem; }
table { border-collapse: collapse; margin: 1rem 0; }
caption { text-align: left; color: #555; padding-bottom: .3rem; }
th, td { border-bottom: 1px solid #ddd; padding: .25rem .8rem .25rem 0; text-align: left; }
td { font-variant-numeric: tabular-nums; }
figure { margin: 1rem 0; } figure img { max-width: 100%; height: auto; }
figcaption { color: #555; }
"""
FORMATS = {'png': 'image/png', 'svg': 'image/svg+xml'}


class Report:
    """Collects parts in order and writes them as one HTML file.

    Every text is escaped, so names from a bag cannot become markup.
    """

    def __init__(self, title: str) -> None:
        self.title = title
        self.figures: list[tuple[str, Figure]] = []
        self._parts: list[str] = []

    def heading(self, text: str) -> Report:
        """Start a section."""
        self._parts.append(f'<h2>{html.escape(text)}</h2>')
        return self

    def text(self, text: str) -> Report:
        """Add a paragraph; an empty line starts the next one."""
        for paragraph in text.split('\n\n'):
            self._parts.append(f'<p>{html.escape(paragraph.strip())}</p>')
        return self

    def table(
        self, header: Sequence[str], rows: Sequence[Sequence[object]], caption: str = ''
    ) -> Report:
        """Add a table; numbers are set with four figures.

        Raises
        ------
        StageError
            If a row has not as many cells as the header.
        """
        lines = ['<table>']
        if caption:
            lines.append(f'<caption>{html.escape(caption)}</caption>')
        cells = ''.join(f'<th scope="col">{html.escape(name)}</th>' for name in header)
        lines.append(f'<thead><tr>{cells}</tr></thead><tbody>')
        for row in rows:
            if len(row) != len(header):
                raise StageError(
                    f'a table row of {len(row)} cells under {len(header)} headings: '
                    'give one cell for each'
                )
            cells = ''.join(f'<td>{html.escape(_cell(value))}</td>' for value in row)
            lines.append(f'<tr>{cells}</tr>')
        self._parts.append('\n'.join([*lines, '</tbody></table>']))
        return self

    def figure(self, figure: Figure, caption: str, image_format: str = 'png') -> Report:
        """Embed a picture as a data URI; the caption is its alternative text too.

        Parameters
        ----------
        image_format : ``png``, or ``svg`` for pictures of few elements.
        """
        if image_format not in FORMATS:
            raise StageError(f'no picture format {image_format!r}: choose png or svg')
        buffer = io.BytesIO()
        figure.savefig(buffer, format=image_format, dpi=110, bbox_inches='tight')
        data = base64.b64encode(buffer.getvalue()).decode('ascii')
        words = html.escape(caption)
        self._parts.append(
            f'<figure><img alt="{words}" src="data:{FORMATS[image_format]};base64,{data}">'
            f'<figcaption>{words}</figcaption></figure>'
        )
        self.figures.append((caption, figure))
        return self

    def render(self) -> str:
        """Return the page as HTML."""
        title = html.escape(self.title)
        body = '\n'.join(self._parts)
        return (
            '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
            '<meta name="viewport" content="width=device-width, initial-scale=1">'
            f'<title>{title}</title><style>{STYLE}</style></head>\n'
            f'<body><main><h1>{title}</h1>\n{body}\n</main></body></html>\n'
        )

    def save(self, path: str | Path) -> Path:
        """Write the page; missing folders are made.

        Raises
        ------
        StageError
            If the file cannot be written.
        """
        target = Path(path)
        try:
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_text(self.render(), encoding='utf-8')
        except OSError as error:
            raise StageError(f'cannot write {target}: {error.strerror}') from error
        return target


def _cell(value: object) -> str:
    if value is None:
        return '-'
    if isinstance(value, float):
        return f'{value:.4g}'
    return str(value)
