"""Reference of nodes, parameters, topics and services, generated from the code.

``python -m stage_bringup.reference docs/reference/reference.md`` writes it; a test compares.
"""

from __future__ import annotations

import ast
import importlib
import sys
import textwrap
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType

from stage_core import topics
from stage_core.errors import StageError
from stage_core.parameters import Parameter
from stage_core.whole_file import write_whole

#: Executable -> module of its node, further modules that create its topics and services.
NODES: dict[str, tuple[str, ...]] = {
    'stage_driver': ('stage_driver.node',),
    'tracker_bridge': ('tracker_bridge.node',),
    'calibrator': ('calibrator.node',),
    'contour_ctrl': ('contour_ctrl.node', 'contour_ctrl.streaming_node'),
    'excite': ('contour_ctrl.excite_node', 'contour_ctrl.streaming_node'),
    'stage_twin': ('stage_twin.node',),
    'session_recorder': ('session_bags.recorder_node',),
    'session_player': ('session_bags.player_node',),
    'gap_diagnosis': ('gap_diagnosis.node',),
    'live_view': ('stage_bringup.live_view_node',),
}
_PUBLISHES, _SUBSCRIBES = 'create_publisher', 'create_subscription'


def _topic(node: ast.expr) -> str | None:
    """Topic of an argument: a literal or a constant of stage_core.topics."""
    if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
        found = getattr(topics, node.attr, None) if node.value.id == 'topics' else None
        return found if isinstance(found, str) else None
    if isinstance(node, ast.Name):
        found = getattr(topics, node.id, None)
        return found if isinstance(found, str) else None
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return node.value if node.value[:1] in '/~' else None
    return None


def interfaces(source: str) -> dict[str, set[str]]:
    """Publishers, subscribers and services that a node's source creates."""
    found: dict[str, set[str]] = {'publishes': set(), 'subscribes': set(), 'services': set()}
    tree = ast.parse(source)
    # Some nodes subscribe in a loop over a table: every topic that a node names and does not
    # publish is one that it reads.
    for attribute in (n for n in ast.walk(tree) if isinstance(n, ast.Attribute)):
        topic = _topic(attribute)
        if topic in topics.TOPIC_TYPES:
            found['subscribes'].add(str(topic))
    for call in (n for n in ast.walk(tree) if isinstance(n, ast.Call)):
        name = call.func.attr if isinstance(call.func, ast.Attribute) else None
        name = call.func.id if isinstance(call.func, ast.Name) else name
        if name is None:
            continue
        named = [t for t in map(_topic, call.args) if t]
        if name == _PUBLISHES:
            found['publishes'].update(named)
        elif name == _SUBSCRIBES:
            found['subscribes'].update(named)
        elif 'service' in name:
            found['services'].update(named)
    found['subscribes'] -= found['publishes']
    return found


def _range(parameter: Parameter) -> str:
    if parameter.choices:
        return ', '.join(f'`{c}`' for c in parameter.choices)
    low, high = parameter.minimum, parameter.maximum
    if low is None and high is None:
        return ''
    return f'{"" if low is None else f"{low:g}"} … {"" if high is None else f"{high:g}"}'.strip()


def parameter_table(parameters: Sequence[Parameter]) -> list[str]:
    """Rows of a Markdown table of parameters."""
    rows = ['| parameter | default | unit | range | description |', '|---|---|---|---|---|']
    for p in sorted(parameters, key=lambda p: p.name):
        default = ', '.join(map(str, p.default)) if isinstance(p.default, list) else p.default
        rows.append(
            f'| `{p.name}` | {default if default != "" else "(empty)"} | {p.unit} | {_range(p)} '
            f'| {p.description.replace("|", "/")} |'
        )
    return rows


def parameters_of(module: ModuleType) -> Sequence[Parameter]:
    """Parameters of a node module: its own or those of the module that it takes them from."""
    for candidate in (module, *(v for v in vars(module).values() if isinstance(v, ModuleType))):
        found = getattr(candidate, 'PARAMETERS', None)
        if found:
            return tuple(found)
    raise StageError(f'{module.__name__} declares no PARAMETERS: declare them in the module')


def render() -> str:
    """The whole reference as Markdown."""
    lines = [
        '# Reference',
        '',
        'Generated from the code by `make reference`.',
        '',
        '## Topics',
        '',
        '| topic | type |',
        '|---|---|',
        *(f'| `{name}` | {kind} |' for name, kind in topics.TOPIC_TYPES.items()),
    ]
    for executable, names in NODES.items():
        modules = [importlib.import_module(name) for name in names]
        package = names[0].split('.')[0]
        lines += ['', f'## {executable}', '', f'`ros2 run {package} {executable}`']
        sources = [Path(str(module.__file__)).read_text(encoding='utf-8') for module in modules]
        found = [interfaces(source) for source in sources]
        for what in ('publishes', 'subscribes', 'services'):
            named = set().union(*(one[what] for one in found))
            if named:
                own = {n.replace(f'/{executable}/', '~/') for n in named}
                listed = f'{what}: ' + ', '.join(f'`{n}`' for n in sorted(own))
                lines += ['', *textwrap.wrap(listed, 100, break_on_hyphens=False)]
        lines += ['', *parameter_table(parameters_of(modules[0]))]
    return '\n'.join(lines) + '\n'


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the reference to the path given."""
    path = Path((list(arguments) if arguments is not None else sys.argv[1:])[0])
    write_whole(path, render())
    print(f'wrote {path}')
    return 0


if __name__ == '__main__':
    sys.exit(main())
