"""Colours of pages and pictures in light and dark, and the style in which pictures are drawn.

A picture is drawn in the light colours. As SVG it carries the dark ones too, so that one file fits
the page in either theme.
"""

from __future__ import annotations

import io
import re
from typing import Any

#: Name -> (light, dark). The six series stay apart for the colour-blind (Okabe and Ito 2008).
COLOURS: dict[str, tuple[str, str]] = {
    'ink': ('#1c2228', '#e3e7eb'),
    'muted': ('#5b6671', '#9aa6b2'),
    'rule': ('#d5dade', '#3a434c'),
    'blue': ('#0072b2', '#56b4e9'),
    'orange': ('#d55e00', '#f0894a'),
    'green': ('#009e73', '#2fc79a'),
    'purple': ('#a8558a', '#d98cbd'),
    'yellow': ('#b07d00', '#e6b422'),
    'cyan': ('#2b8fc7', '#8fd0f5'),
}
INK, MUTED, RULE, BLUE, ORANGE, GREEN, PURPLE, YELLOW, CYAN = (c[0] for c in COLOURS.values())
SERIES = (BLUE, ORANGE, GREEN, PURPLE, YELLOW, CYAN)

#: What matplotlib's `rc_context` takes. Backgrounds are clear: the page's shows through.
STYLE: dict[str, Any] = {
    'figure.facecolor': 'none',
    'axes.facecolor': 'none',
    'axes.edgecolor': MUTED,
    'axes.labelcolor': INK,
    'axes.titlecolor': INK,
    'axes.titlesize': 11.0,
    'axes.titlelocation': 'left',
    'axes.spines.top': False,
    'axes.spines.right': False,
    'axes.grid': True,
    'axes.axisbelow': True,
    'grid.color': RULE,
    'grid.linewidth': 0.8,
    'text.color': INK,
    'xtick.color': MUTED,
    'ytick.color': MUTED,
    'xtick.labelcolor': INK,
    'ytick.labelcolor': INK,
    'legend.frameon': False,
    'legend.fontsize': 9.0,
    'font.size': 10.0,
}


def variables(theme: int) -> str:
    """Declarations of the colours as CSS variables; `theme` 0 is light, 1 dark."""
    return ''.join(f'--{name}:{pair[theme]};' for name, pair in COLOURS.items())


def svg(figure: Any) -> str:
    """A matplotlib figure as SVG text whose colours follow the reader's theme."""
    # Whoever has a figure has matplotlib; the rest of this package does without it.
    import matplotlib

    buffer = io.StringIO()
    # With a salt of its own, equal figures make equal files.
    with matplotlib.rc_context({'svg.fonttype': 'path', 'svg.hashsalt': 'stage'}):
        figure.savefig(buffer, format='svg', metadata={'Date': None, 'Creator': None})
    text = buffer.getvalue()
    text = text[text.index('<svg') :]
    for name, (light, _) in COLOURS.items():
        text = text.replace(light, f'var(--{name})')
    style = (
        f'<style>:root{{{variables(0)}fill:var(--ink)}}'
        f'@media screen and (prefers-color-scheme:dark){{:root{{{variables(1)}}}}}</style>'
    )
    head = text.index('>') + 1
    return text[:head] + style + text[head:]


def columns(figure: Any) -> list[tuple[float, str]]:
    """Width (share) and SVG of the left and the right half of panels that stand side by side.

    A narrow screen can then stack them. A picture of one column, or with a legend for both, stays
    one.
    """
    text = svg(figure)
    # Where no panel with its labels is, nearest to the middle.
    spans = sorted((b.x0, b.x1) for a in figure.axes if (b := a.get_tightbbox()) is not None)
    cuts, right = [], spans[0][1]
    for low, high in spans:
        if low > right:
            cuts.append((low + right) / 2.0 / figure.bbox.width)
        right = max(right, high)
    if not cuts or figure.legends:
        return [(1.0, text)]
    cut = min(cuts, key=lambda share: abs(share - 0.5))
    return [(cut, _part(text, 0.0, cut)), (1.0 - cut, _part(text, cut, 1.0 - cut))]


def _part(text: str, left: float, share: float) -> str:
    """The SVG `text` from `left` on, so wide; both are shares of its width."""
    found = re.search(r'width="([\d.]+)pt" height="([\d.]+)pt" viewBox="0 0 \S+ \S+"', text)
    if found is None:
        raise ValueError('an SVG that matplotlib did not write')
    width, height = float(found[1]), float(found[2])
    box = f'{left * width:.2f} 0 {share * width:.2f} {height}'
    head = f'width="{share * width:.2f}pt" height="{height}pt" viewBox="{box}"'
    return text[: found.start()] + head + text[found.end() :]
