"""``ros2 param list|get|set|describe|dump``."""

from __future__ import annotations

import argparse
import sys
from typing import Any

import yaml

from ros2_standin.graph_node import call, node, node_names, parameter_message, require_node, settle
from ros2_standin.messages import interface
from stage_core.errors import StageError
from stage_core.untrusted import yaml_value

#: ROS type number -> field of a ParameterValue, word for one value.
_FIELDS = {
    1: ('bool_value', 'Boolean value is:'),
    2: ('integer_value', 'Integer value is:'),
    3: ('double_value', 'Double value is:'),
    4: ('string_value', 'String value is:'),
    5: ('byte_array_value', 'Byte values are:'),
    6: ('bool_array_value', 'Boolean values are:'),
    7: ('integer_array_value', 'Integer values are:'),
    8: ('double_array_value', 'Double values are:'),
    9: ('string_array_value', 'String values are:'),
}
_NAMES = {
    1: 'boolean', 2: 'integer', 3: 'double', 4: 'string', 5: 'byte array', 6: 'boolean array',
    7: 'integer array', 8: 'double array', 9: 'string array',
}  # fmt: skip


def add_verbs(parser: argparse.ArgumentParser) -> None:
    """Declare the verbs."""
    verbs = parser.add_subparsers(dest='verb', required=True, metavar='verb')
    verb = verbs.add_parser('list', help='Output a list of available parameters')
    verb.add_argument('node_name', nargs='?')
    verb.set_defaults(run=list_parameters)
    verb = verbs.add_parser('get', help='Get parameter')
    verb.add_argument('node_name')
    verb.add_argument('parameter_name')
    verb.add_argument('--hide-type', action='store_true')
    verb.set_defaults(run=get)
    verb = verbs.add_parser('set', help='Set parameter')
    verb.add_argument('node_name')
    verb.add_argument('parameter_name')
    verb.add_argument('value')
    verb.set_defaults(run=set_parameter)
    verb = verbs.add_parser('describe', help='Show descriptive information about a parameter')
    verb.add_argument('node_name')
    verb.add_argument('parameter_names', nargs='+')
    verb.set_defaults(run=describe)
    verb = verbs.add_parser('dump', help='Show all of the parameters of a node in YAML')
    verb.add_argument('node_name')
    verb.set_defaults(run=dump)


def _names(looker: Any, name: str) -> list[str]:
    kind = interface('rcl_interfaces/srv/ListParameters', 'srv')
    response = call(looker, kind, f'{name}/list_parameters', kind.Request())
    return sorted(response.result.names)


def _values(looker: Any, name: str, parameters: list[str]) -> list[Any]:
    kind = interface('rcl_interfaces/srv/GetParameters', 'srv')
    request = kind.Request(names=parameters)
    return list(call(looker, kind, f'{name}/get_parameters', request).values)


def _plain(value: Any) -> Any:
    field = _FIELDS.get(value.type)
    if field is None:
        return None
    content = getattr(value, field[0])
    return content if isinstance(content, (bool, int, float, str)) else list(content)


def list_parameters(arguments: argparse.Namespace) -> None:
    """Print the parameters of one node or of all."""
    with node() as looker:
        if arguments.node_name:
            nodes = [require_node(looker, arguments.node_name)]
        else:
            settle(looker)
            services = dict(looker.get_service_names_and_types())
            nodes = [n for n in node_names(looker) if f'{n}/list_parameters' in services]
        for name in nodes:
            if not arguments.node_name:
                print(f'{name}:')
            for parameter in _names(looker, name):
                print(f'  {parameter}')


def get(arguments: argparse.Namespace) -> None:
    """Print one parameter."""
    with node() as looker:
        name = require_node(looker, arguments.node_name)
        (value,) = _values(looker, name, [arguments.parameter_name]) or (None,)
    if value is None or value.type not in _FIELDS:
        raise StageError('Parameter not set')
    text = _plain(value)
    print(text if arguments.hide_type else f'{_FIELDS[value.type][1]} {text}')


def set_parameter(arguments: argparse.Namespace) -> int:
    """Set one parameter; its text is read as YAML."""
    kind = interface('rcl_interfaces/srv/SetParameters', 'srv')
    try:
        value = yaml_value(arguments.value, 'the value', 'it is taken as text')
    except StageError:
        value = None
    if isinstance(value, (dict, type(None))):
        value = arguments.value
    with node() as looker:
        name = require_node(looker, arguments.node_name)
        (known,) = _values(looker, name, [arguments.parameter_name]) or (None,)
        if known is not None and known.type == 3 and type(value) is int:
            value = float(value)
        if known is not None and known.type == 4 and not isinstance(value, str):
            value = arguments.value
        parameter = parameter_message(arguments.parameter_name, value)
        request = kind.Request(parameters=[parameter])
        (result,) = call(looker, kind, f'{name}/set_parameters', request).results
    reason = f': {result.reason}' if result.reason else ''
    if not result.successful:
        print(f'Setting parameter failed{reason}', file=sys.stderr)
        return 1
    print(f'Set parameter successful{reason}')
    return 0


def describe(arguments: argparse.Namespace) -> None:
    """Print what a parameter is for, and its range."""
    kind = interface('rcl_interfaces/srv/DescribeParameters', 'srv')
    with node() as looker:
        name = require_node(looker, arguments.node_name)
        request = kind.Request(names=arguments.parameter_names)
        service = f'{name}/describe_parameters'
        found = call(looker, kind, service, request).descriptors
    for item in found:
        print(f'Parameter name: {item.name}\n  Type: {_NAMES.get(item.type, "not set")}')
        if item.description:
            print(f'  Description: {item.description}')
        print('  Constraints:')
        for bounds in (*item.floating_point_range, *item.integer_range):
            print(f'    Min value: {bounds.from_value}\n    Max value: {bounds.to_value}')
        if item.read_only:
            print('    Read only: true')
        if item.additional_constraints:
            print(f'    Additional constraints: {item.additional_constraints}')


def dump(arguments: argparse.Namespace) -> None:
    """Print the parameters of a node as a parameter file."""
    with node() as looker:
        name = require_node(looker, arguments.node_name)
        names = _names(looker, name)
        values = _values(looker, name, names)
    tree: dict[str, Any] = {}
    for parameter, value in zip(names, values, strict=True):
        *groups, last = parameter.split('.')
        branch = tree
        for group in groups:
            branch = branch.setdefault(group, {})
        branch[last] = _plain(value)
    print(yaml.safe_dump({name: {'ros__parameters': tree}}, default_flow_style=False), end='')
