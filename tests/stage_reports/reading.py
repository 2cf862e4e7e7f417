"""What is in a page."""

from __future__ import annotations

import base64
import re
from html.parser import HTMLParser

#: What no person reads.
CODE = re.compile(r'<(script|style)\b.*?</\1>', re.DOTALL)


class Page(HTMLParser):
    def __init__(self, text: str) -> None:
        super().__init__()
        self.sources: list[str] = []
        self.alternatives: list[str] = []
        self.scripts = 0
        self.words: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        values = dict(attrs)
        self.scripts += tag == 'script'
        if tag == 'img':
            self.sources.append(values['src'] or '')
            self.alternatives.append(values['alt'] or '')
        assert tag != 'link'

    def handle_data(self, data: str) -> None:
        self.words.append(data)


def words(html: str) -> str:
    return ' '.join(' '.join(Page(html).words).split())


def seen(html: str) -> str:
    """What a person reads on a page: its words, and the labels of its pictures."""
    page = Page(CODE.sub('', html))
    pictures = [base64.b64decode(source.partition(',')[2]).decode() for source in page.sources]
    # matplotlib draws letters as curves and keeps the label in a comment.
    labels = [label for picture in pictures for label in re.findall(r'<!-- (.*?) -->', picture)]
    assert not pictures or labels
    return ' '.join([*page.words, *labels])
