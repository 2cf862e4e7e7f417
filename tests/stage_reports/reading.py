"""What is in a page."""

from __future__ import annotations

from html.parser import HTMLParser


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
