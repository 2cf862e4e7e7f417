"""Changes of attributes in an XML file that leave every other byte as it was."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from xml.parsers import expat

from stage_core.errors import StageError
from stage_core.untrusted import file_text

NOT_XML = 'give a model file of well-formed XML'
#: A start tag from its `<` on: quoted values may hold a `>`.
TAG = re.compile(rb'<[^\s/>]+(?:[^>"\']|"[^"]*"|\'[^\']*\')*>')


@dataclass(frozen=True)
class Element:
    """A start tag: its name, its attributes, the names of what encloses it, and where it is."""

    tag: str
    attributes: dict[str, str]
    path: tuple[str, ...]
    number: int  # of the start tag in the file, from 0
    parent: int  # number of the enclosing element, -1 for the root


@dataclass(frozen=True)
class Change:
    """One attribute: the element's name in words, the old value (None: absent), the new one."""

    where: str
    attribute: str
    old: str | None
    new: str


class XmlText:
    """A file's text with its start tags.

    Raises
    ------
    StageError
        If the file cannot be read or is no XML.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        file_text(path, f'model file {path}', NOT_XML)
        self._bytes = self.path.read_bytes()  # with the line ends that it has
        self.elements: list[Element] = []
        self._starts: list[int] = []
        self.changes: list[Change] = []
        self._parse()

    def _parse(self) -> None:
        parser, enclosing = expat.ParserCreate(), [-1]
        self.elements, self._starts = [], []

        def start(tag: str, attributes: dict[str, str]) -> None:
            number = len(self.elements)
            path = tuple(self.elements[k].tag for k in enclosing[1:])
            self.elements.append(Element(tag, attributes, path, number, enclosing[-1]))
            self._starts.append(parser.CurrentByteIndex)
            enclosing.append(number)

        parser.StartElementHandler = start
        parser.EndElementHandler = lambda tag: enclosing.pop()
        try:
            parser.Parse(self._bytes, True)
        except expat.ExpatError as error:
            raise StageError(f'{self.path} is no XML ({error}): {NOT_XML}') from error

    @property
    def text(self) -> str:
        """The text as it stands now."""
        return self._bytes.decode()

    def find(self, wanted: Callable[[Element], bool]) -> Element | None:
        """The first element that is wanted."""
        return next((e for e in self.elements if wanted(e)), None)

    def children(self, element: Element, tag: str) -> list[Element]:
        """The elements of that tag right inside another one."""
        return [e for e in self.elements if e.parent == element.number and e.tag == tag]

    def parent(self, element: Element) -> Element:
        """The element around another one."""
        return self.elements[element.parent]

    def set(self, element: Element, where: str, attribute: str, value: str) -> None:
        """Give an attribute a value; `where` names the element for people."""
        start, tag = self._tag(element)
        old = self.elements[element.number].attributes.get(attribute)
        if old == value:
            return
        if old is None:
            end = len(tag) - (2 if tag.endswith(b'/>') else 1)
            end = len(tag[:end].rstrip())
            new = tag[:end] + f' {attribute}="{value}"'.encode() + tag[end:]
        else:
            pattern = rb'(\s' + attribute.encode() + rb'\s*=\s*)("[^"]*"|\'[^\']*\')'
            new = re.sub(pattern, lambda m: m.group(1) + f'"{value}"'.encode(), tag, count=1)
        self.changes.append(Change(where, attribute, old, value))
        self._replace(start, tag, new)

    def rename(self, element: Element, tag: str) -> None:
        """Give an element without content another tag."""
        start, old = self._tag(element)
        name, new = element.tag.encode(), tag.encode()
        whole = old
        if not old.endswith(b'/>'):
            whole = self._bytes[start : self._bytes.index(b'>', start + len(old)) + 1]
        renamed = re.sub(rb'^<' + name, b'<' + new, whole).replace(b'</' + name, b'</' + new)
        self._replace(start, whole, renamed)

    def insert(self, element: Element, where: str, tag: str, attributes: dict[str, str]) -> None:
        """Put a new element without content at the start of another one."""
        start, old = self._tag(element)
        values = ' '.join(f'{name}="{value}"' for name, value in attributes.items())
        line = self._bytes[self._bytes.rfind(b'\n', 0, start) + 1 : start]
        margin = line if not line.strip() else b''
        self.changes.append(Change(where, tag, None, values))
        new = old + b'\n' + margin + b'  ' + f'<{tag} {values}/>'.encode()
        self._replace(start, old, new)

    def _tag(self, element: Element) -> tuple[int, bytes]:
        start = self._starts[element.number]
        found = TAG.match(self._bytes, start)
        assert found is not None
        return start, found.group()

    def _replace(self, start: int, old: bytes, new: bytes) -> None:
        self._bytes = self._bytes[:start] + new + self._bytes[start + len(old) :]
        self._parse()
