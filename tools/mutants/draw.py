"""Draws mutants by a seed, as many from every package, and finds them again in changed source."""

from __future__ import annotations

import ast
import json
import random
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
LIST = Path(__file__).with_name('drawn.json')

COMPARISONS: dict[type, type] = {
    ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq, ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In,
}  # fmt: skip
ARITHMETIC: dict[type, type] = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult,
}  # fmt: skip


@dataclass(frozen=True)
class Mutant:
    """One change: the `nth` place in `function` that reads `before` becomes `after`."""

    package: str
    file: str
    function: str
    nth: int
    before: str
    after: str


@dataclass(frozen=True)
class Site:
    """Where a mutant applies: offsets of `mutant.before` in the text of its file."""

    mutant: Mutant
    start: int
    end: int


def changed(node: ast.AST) -> ast.expr | None:
    """Return the node with its operator or number replaced, None if it has none."""
    match node:
        case ast.Compare(left, [operator], others) if type(operator) in COMPARISONS:
            return ast.Compare(left, [COMPARISONS[type(operator)]()], others)
        case ast.BinOp(left, operator, right) if type(operator) in ARITHMETIC:
            return ast.BinOp(left, ARITHMETIC[type(operator)](), right)
        case ast.BoolOp(operator, values):
            return ast.BoolOp(ast.Or() if isinstance(operator, ast.And) else ast.And(), values)
        case ast.UnaryOp(ast.Not(), operand):
            return operand
        case ast.Constant(bool() as value):
            return ast.Constant(not value)
        case ast.Constant(int() | float() as value):
            return ast.Constant(2 * value if isinstance(value, float) and value else value + 1)
    return None


def sites(text: str, package: str, file: str) -> list[Site]:
    """Return every place of a file that a mutant may change, in order of the text."""
    starts = [0]
    for line in text.splitlines(keepends=True):
        starts.append(starts[-1] + len(line.encode()))
    raw = text.encode()
    found: list[Site] = []
    counts: dict[tuple[str, str], int] = {}
    for function, node in _nodes(ast.parse(text), ''):
        after = changed(node)
        if after is None or not isinstance(node, ast.expr) or node.end_lineno is None:
            continue
        start = starts[node.lineno - 1] + node.col_offset
        end = starts[node.end_lineno - 1] + (node.end_col_offset or 0)
        before = raw[start:end].decode()
        nth = counts.get((function, before), 0)
        counts[function, before] = nth + 1
        mutant = Mutant(package, file, function, nth, before, f'({ast.unparse(after)})')
        found.append(Site(mutant, start, end))
    return found


def _nodes(tree: ast.AST, function: str) -> Iterator[tuple[str, ast.AST]]:
    """Yield the nodes of statements inside functions, with the function's dotted name."""
    for child in ast.iter_child_nodes(tree):
        if isinstance(child, ast.JoinedStr):
            continue
        name = function
        if isinstance(child, ast.FunctionDef | ast.ClassDef | ast.AsyncFunctionDef):
            name = f'{function}.{child.name}'.lstrip('.')
            for statement in child.body:
                yield from _nodes(ast.Module([statement], []), name)
            continue
        if function:
            yield name, child
        yield from _nodes(child, name)


def draw(count: int, seed: int) -> list[Mutant]:
    """Draw `count` mutants, as many from every package of src, evenly over its places."""
    chance = random.Random(seed)
    packages = sorted(p for p in (ROOT / 'src').iterdir() if (p / 'package.xml').is_file())
    drawn: list[Mutant] = []
    for i, package in enumerate(packages):
        places = [
            site.mutant
            for path in sorted(package.glob('*/**/*.py'))
            for site in sites(path.read_text(), package.name, str(path.relative_to(ROOT)))
        ]
        share = count * (i + 1) // len(packages) - count * i // len(packages)
        drawn += chance.sample(places, share)
    return drawn


def store(mutants: list[Mutant], seed: int) -> None:
    """Write the list that the runs work through."""
    entries = [asdict(mutant) for mutant in mutants]
    LIST.write_text(json.dumps({'seed': seed, 'mutants': entries}, indent=1) + '\n')


def stored() -> list[Mutant]:
    """Read the list that was drawn."""
    return [Mutant(**entry) for entry in json.loads(LIST.read_text())['mutants']]


def find(mutant: Mutant, root: Path) -> tuple[Path, str] | None:
    """Return file and changed text, None if the source has no such place any more.

    A function that moved is looked for in the whole package.
    """
    package = root / 'src' / mutant.package
    for path in [root / mutant.file, *sorted(package.glob('*/**/*.py'))]:
        if not path.is_file():
            continue
        text = path.read_text()
        for site in sites(text, mutant.package, mutant.file):
            if site.mutant == mutant:
                raw = text.encode()
                return path, (raw[: site.start] + mutant.after.encode() + raw[site.end :]).decode()
    return None
