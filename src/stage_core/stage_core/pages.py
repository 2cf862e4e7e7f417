"""The one writer of HTML pages: a self-contained file for light, dark, narrow, wide and paper.

A page loads nothing. It runs a script only to read values off curves (`explore`), and shows the
same pictures without it. Every text is escaped, so that a name from a bag cannot become markup;
words between backticks are set as code.
"""

from __future__ import annotations

import base64
import html
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from stage_core import explore, theme
from stage_core.errors import StageError
from stage_core.whole_file import replacing, write_whole

#: A picture wider than this (inches) gets a row of its own, and on a phone one column of panels.
_WIDE = 7.0
_PHONE = 'screen and (max-width:40rem)'
#: A cell of more letters than this is a sentence: the longest numbers with an interval have less.
_SENTENCE = 24

_CSS = """
*{box-sizing:border-box}
html{color-scheme:light dark;-webkit-text-size-adjust:100%}
body{font:16px/1.55 system-ui,'Segoe UI',sans-serif;color:var(--ink);background:var(--page);
margin:0 auto;max-width:74rem;padding:1.2rem clamp(1rem,4vw,3rem) 4rem}
h1{font-size:1.55rem;line-height:1.25;margin:.8rem 0}
h2{font-size:1.2rem;margin:2.6rem 0 .6rem}h3{font-size:1rem;margin:1.6rem 0 .4rem}
p,li{max-width:44rem}a{color:var(--blue)}
code{font:.9em ui-monospace,monospace;background:var(--card);padding:.1em .3em;border-radius:3px;
overflow-wrap:anywhere}
nav{display:flex;flex-wrap:wrap;gap:.3rem 1.4rem;border-bottom:1px solid var(--rule);
padding-bottom:.6rem;font-size:.95rem}nav [aria-current]{font-weight:650}
.headline{background:var(--card);border-left:5px solid var(--blue);padding:1rem 1.2rem;
margin:1rem 0}.headline.warn{border-color:var(--orange)}
.headline p{margin:.2rem 0 0}.headline .value{font-size:1.65rem;font-weight:650;line-height:1.3;
margin:0;max-width:none}
dl{display:grid;grid-template-columns:repeat(auto-fill,minmax(min(100%,15rem),1fr));
gap:.7rem 1.6rem;margin:1.2rem 0}dt{color:var(--muted);font-size:.85rem}dd{margin:0}
.scroll{overflow-x:auto;margin:1rem 0}table{border-collapse:collapse}
caption{text-align:left;color:var(--muted);padding-bottom:.3rem;font-size:.92rem}
th,td{border-bottom:1px solid var(--rule);padding:.35rem 1.3rem .35rem 0;text-align:left;
vertical-align:top}td{font-variant-numeric:tabular-nums}
.cards{display:grid;grid-template-columns:repeat(auto-fit,minmax(min(100%,15rem),1fr));gap:1rem;
margin:1rem 0}.cards a{display:block;border:1px solid var(--rule);border-radius:6px;
padding:.8rem 1rem;color:inherit;text-decoration:none}.cards a:hover{border-color:var(--blue)}
.cards b{color:var(--blue)}.cards span{display:block;color:var(--muted);font-size:.94rem}
.figures{display:grid;grid-template-columns:repeat(auto-fit,minmax(min(100%,max(21rem,40%)),1fr));
gap:1.4rem 2rem;margin:1.2rem 0}figure{margin:0;min-width:0}figure.wide{grid-column:1/-1}
figure:only-child:not(.wide){max-width:34rem}
figure img{display:block;width:100%;height:auto}.plot{position:relative}
.scroll{background:
linear-gradient(90deg,var(--page) 1rem,transparent) 0 0/3rem 100% local,
linear-gradient(270deg,var(--page) 1rem,transparent) 100% 0/3rem 100% local,
linear-gradient(90deg,var(--rule),transparent) 0 0/.8rem 100%,
linear-gradient(270deg,var(--rule),transparent) 100% 0/.8rem 100%;background-repeat:no-repeat}
.plot canvas{position:absolute;inset:0;width:100%;height:100%;cursor:crosshair}
output{display:block;font-size:.85rem;color:var(--muted);min-height:1.5em}
figcaption{color:var(--muted);font-size:.92rem;max-width:44rem;
margin-top:.3rem}figcaption b{color:var(--ink)}
details{margin:1rem 0}
@media (max-width:40rem){th,td{padding-right:.6rem;font-size:.86rem}
caption{max-width:calc(100vw - 2rem)}}
@media screen and (max-width:52rem){.prose thead{display:none}.prose caption{display:block}
.prose,.prose tbody,.prose tr,.prose td{display:block;border:0;padding:0}.prose td{font-size:1rem}
.prose td:empty{display:none}.prose tr{border-bottom:1px solid var(--rule);padding:.5rem 0}
.prose td:first-child{font-weight:650}
.prose td:not(:first-child)::before{content:attr(data-of)': ';color:var(--muted)}}
summary{cursor:pointer;color:var(--blue)}
footer{margin-top:3rem;color:var(--muted);font-size:.88rem}
@page{margin:14mm}
@media print{html{color-scheme:light}body{font-size:10.5pt;max-width:none;padding:0}
h2,h3,h2+p,caption{break-after:avoid}
figure,tr,table:not(:has(tr:nth-child(12))),.headline{break-inside:avoid}
nav,canvas,output,details:not([open]){display:none}
.figures{grid-template-columns:repeat(auto-fit,minmax(18rem,1fr))}
.scroll{background:none}}
"""


#: Name and address of a page; an empty address is the page itself.
Entry = tuple[str, str]


def css() -> str:
    """The style of every page, with the colours of both themes."""
    light = f'{theme.variables(0)}--page:#fff;--card:#f3f6f8'
    dark = f'{theme.variables(1)}--page:#14181c;--card:#1f262d'
    return (
        f':root{{{light}}}@media screen and (prefers-color-scheme:dark){{:root{{{dark}}}}}' + _CSS
    )


class Page:
    """Collects the parts of a page in order and writes them as one file.

    Parameters
    ----------
    title : what the page shows, as its heading.
    """

    def __init__(self, title: str) -> None:
        self.title = title
        self.figures: list[tuple[str, Any]] = []
        self.brief = ''
        self._nav = ''
        self._parts: list[str] = []
        self._row: list[str] = []
        self._script = ''

    def navigation(self, entries: Sequence[Entry]) -> Page:
        """Links to the pages of this session, (name, address); an empty address is this page."""
        self._nav = _navigation(entries)
        return self

    def headline(self, value: str, meaning: str, brief: str = '', warn: bool = False) -> Page:
        """The one figure that counts, with its interval, and what it says.

        `brief` follows the figure where another page links to this one.
        """
        self.brief = f'{value} {brief}'.strip()
        kind = 'headline warn' if warn else 'headline'
        return self._add(
            f'<div class="{kind}"><p class="value">{_text(value)}</p><p>{_text(meaning)}</p></div>'
        )

    def conditions(self, entries: Sequence[tuple[str, str]]) -> Page:
        """Under what conditions it was measured: (name, value); empty values are left out."""
        return self._add(f'<dl>{_conditions(entries)}</dl>')

    def heading(self, text: str) -> Page:
        """Start a section."""
        return self._add(f'<h2>{_text(text)}</h2>')

    def subheading(self, text: str) -> Page:
        """Start a part of a section."""
        return self._add(f'<h3>{_text(text)}</h3>')

    def text(self, text: str) -> Page:
        """Add paragraphs; an empty line starts the next one."""
        return self._add(''.join(f'<p>{_text(p.strip())}</p>' for p in text.split('\n\n')))

    def items(self, texts: Sequence[str]) -> Page:
        """Add a list."""
        return self._add(f'<ul>{"".join(f"<li>{_text(t)}</li>" for t in texts)}</ul>')

    def cards(self, entries: Sequence[tuple[str, str, str]]) -> Page:
        """Links with what is found there: (name, address, sentence)."""
        cards = (
            f'<a href="{html.escape(address)}"><b>{_text(name)}</b><span>{_text(says)}</span></a>'
            for name, address, says in entries
        )
        return self._add(f'<div class="cards">{"".join(cards)}</div>')

    def table(
        self, header: Sequence[str], rows: Sequence[Sequence[object]], caption: str = ''
    ) -> Page:
        """Add a table; cells are shown as they are, numbers to four digits, None as a dash.

        Raises
        ------
        StageError
            If a row has another number of cells than the header.
        """
        lines = [f'<caption>{_text(caption)}</caption>'] if caption else []
        names = ''.join(f'<th scope="col">{_text(name)}</th>' for name in header)
        lines.append(f'<thead><tr>{names}</tr></thead><tbody>')
        for row in rows:
            if len(row) != len(header):
                raise StageError(
                    f'a table row of {len(row)} cells under {len(header)} headings: '
                    'give one cell for each'
                )
            cells = zip(header, map(_cell, row), strict=True)
            lines.append(f'<tr>{"".join(_data(name, text) for name, text in cells)}</tr>')
        # Sentences are not read through a slit: on a narrow screen each row is a list.
        prose = any(isinstance(v, str) and len(v) > _SENTENCE for row in rows for v in row)
        start = '<table class="prose">' if prose else '<table>'
        body = ''.join(lines)
        return self._add(f'<div class="scroll">{start}{body}</tbody></table></div>')

    def figure(self, figure: Any, title: str, look_for: str, curves: bool = False) -> Page:
        """Embed a matplotlib figure; pictures that follow each other stand side by side.

        Parameters
        ----------
        title : what it shows; the alternative text too.
        look_for : what the reader should look for in it.
        curves : whether a reader can read values off its curves and zoom into them.
        """
        wide = figure.get_figwidth() > _WIDE
        kind = ' class="wide"' if wide else ''
        with theme.laid_out(figure):
            image = f'<img alt="{html.escape(title)}" src="{_address(theme.svg(figure))}">'
            places = [explore.places(figure)] if curves else []
        if wide:
            with theme.one_column(figure), theme.laid_out(figure):
                image = f'<source media="{_PHONE}" srcset="{_address(theme.svg(figure))}">{image}'
                places += [explore.places(figure)] if curves else []
        self._row.append(
            f'<figure{kind}><div class="plot"><picture>{image}</picture></div>'
            f'<figcaption><b>{_text(title)}.</b> {_text(look_for)}</figcaption>'
            f'{self._curves(figure, places) if curves else ""}</figure>'
        )
        self.figures.append((title, figure))
        return self

    def _curves(self, figure: Any, places: list[explore.Places]) -> str:
        self._script = f'<script>{explore.script()}</script>'
        data = explore.data(figure, places)
        return f'<script type="application/json" class="curves">{data}</script>'

    @contextmanager
    def folded(self, summary: str) -> Iterator[Page]:
        """What is added inside is hidden until the reader opens it."""
        self._add(f'<details><summary>{_text(summary)}</summary>')
        yield self
        self._add('</details>')

    def _add(self, part: str) -> Page:
        self._close_row()
        self._parts.append(part)
        return self

    def _close_row(self) -> None:
        if self._row:
            self._parts.append(f'<div class="figures">{"".join(self._row)}</div>')
            self._row = []

    def render(self) -> str:
        """The page as HTML."""
        self._close_row()
        title, body = html.escape(self.title), '\n'.join(self._parts)
        return (
            '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
            '<meta name="viewport" content="width=device-width, initial-scale=1">'
            f'<title>{title}</title><style>{css()}</style></head>\n'
            f'<body>{self._nav}<main><h1>{title}</h1>\n{body}\n</main>{self._script}</body></html>\n'
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
            write_whole(target, self.render())
        except OSError as error:
            raise StageError(f'cannot write {target}: {error.strerror}') from error
        return target

    def save_pictures(self, folder: Path, name: str) -> None:
        """Write each picture as ``<name>_<number>.png`` on white."""
        for number, (_, figure) in enumerate(self.figures, 1):
            with replacing(folder / f'{name}_{number:02d}.png') as stream:
                figure.savefig(stream, format='png', dpi=110, facecolor='white')


def add_navigation(path: Path, entries: Sequence[Entry]) -> None:
    """Put links into a page that another program has written without any."""
    text = path.read_text(encoding='utf-8')
    write_whole(path, text.replace('<body><main>', f'<body>{_navigation(entries)}<main>', 1))


def add_conditions(path: Path, entries: Sequence[tuple[str, str]]) -> None:
    """Put conditions (name, value) before those of a page that another program has written."""
    text = path.read_text(encoding='utf-8')
    write_whole(path, text.replace('<dl>', f'<dl>{_conditions(entries)}', 1))


def _conditions(entries: Sequence[tuple[str, str]]) -> str:
    return ''.join(f'<div><dt>{_text(n)}</dt><dd>{_text(v)}</dd></div>' for n, v in entries if v)


def _navigation(entries: Sequence[Entry]) -> str:
    links = (
        f'<a href="{html.escape(address)}">{html.escape(name)}</a>'
        if address
        else f'<span aria-current="page">{html.escape(name)}</span>'
        for name, address in entries
    )
    return f'<nav>{"".join(links)}</nav>'


def _text(text: str) -> str:
    # A number and its unit stay in one line.
    text = re.sub(r'(?<=\d) (?=(?:µm|mm|µrad|rad|N|°C|%|s)\b|%)', '\u00a0', text)
    return re.sub(r'`([^`]+)`', r'<code>\1</code>', html.escape(text, quote=False))


def _address(svg: str) -> str:
    """A picture as an address that holds it."""
    return f'data:image/svg+xml;base64,{base64.b64encode(svg.encode()).decode("ascii")}'


def _data(name: str, text: str) -> str:
    """A cell with the heading that it stands under."""
    return f'<td data-of="{html.escape(name)}">{_text(text)}</td>'


def _cell(value: object) -> str:
    if value is None:
        return '–'
    text = f'{value:.4g}' if isinstance(value, float) else str(value)
    return re.sub(r'^-(?=\d)', '−', text)
