"""``ros2 param list|get|set``."""

from __future__ import annotations

import argparse
import sys
from typing import Any

from ros2_standin.graph_node import Looker
from stage_core.errors import StageError
from stage_core.untrusted import yaml_value

_WORDS = {bool: 'Boolean', int: 'Integer', float: 'Double', str: 'String'}


def add_verbs(parser: argparse.ArgumentParser) -> None:
    """Declare the verbs."""
    verbs = parser.add_subparsers(dest='verb', required=True, metavar='verb')
    verb = verbs.add_parser('list', help='Output a list of available parameters')
    verb.add_argument('node_name')
    verb.set_defaults(run=list_parameters)
    verb = verbs.add_parser('get', help='Get parameter')
    verb.add_argument('node_name')
    verb.add_argument('parameter_name')
    verb.set_defaults(run=get)
    verb = verbs.add_parser('set', help='Set parameter')
    verb.add_argument('node_name')
    verb.add_argument('parameter_name')
    verb.add_argument('value')
    verb.set_defaults(run=set_parameter)


def _call(looker: Looker, node: str, service: str, **request: Any) -> Any:
    import rcl_interfaces.srv as services

    kind = getattr(services, service)
    words = {'ListParameters': 'list', 'GetParameters': 'get', 'SetParameters': 'set'}
    name = f'{looker.named_node(node)}/{words[service]}_parameters'
    return looker.call(kind, name, kind.Request(**request), 10.0)


def _value(looker: Looker, node: str, name: str) -> Any:
    """Value of a parameter; None where it is not set."""
    from rclpy.parameter import parameter_value_to_python

    values = _call(looker, node, 'GetParameters', names=[name]).values
    return parameter_value_to_python(values[0]) if values else None


def list_parameters(arguments: argparse.Namespace) -> None:
    """Print the parameters of a node."""
    with Looker() as looker:
        names = _call(looker, arguments.node_name, 'ListParameters').result.names
    for name in sorted(names):
        print(f'  {name}')


def get(arguments: argparse.Namespace) -> None:
    """Print one parameter."""
    with Looker() as looker:
        value = _value(looker, arguments.node_name, arguments.parameter_name)
    if value is None:
        raise StageError('Parameter not set')
    if type(value) in _WORDS:
        print(f'{_WORDS[type(value)]} value is: {value}')
    else:
        print(f'{_WORDS[type(value[0])] if len(value) else "Array"} values are: {list(value)}')


def set_parameter(arguments: argparse.Namespace) -> int:
    """Set one parameter; its text is read as YAML."""
    from rclpy.parameter import Parameter

    try:
        value = yaml_value(arguments.value, 'the value', 'it is taken as text')
    except StageError:
        value = None
    with Looker() as looker:
        known = _value(looker, arguments.node_name, arguments.parameter_name)
        if isinstance(known, float) and type(value) is int:
            value = float(value)
        if isinstance(value, (dict, type(None))) or isinstance(known, str):
            value = arguments.value
        try:
            message = Parameter(arguments.parameter_name, value=value).to_parameter_msg()
        except (TypeError, ValueError, AssertionError) as error:
            raise StageError(
                f'{arguments.parameter_name} cannot be {value!r}: name a number, a word or a list'
            ) from error
        (result,) = _call(
            looker, arguments.node_name, 'SetParameters', parameters=[message]
        ).results
    reason = f': {result.reason}' if result.reason else ''
    if not result.successful:
        print(f'Setting parameter failed{reason}', file=sys.stderr)
        return 1
    print(f'Set parameter successful{reason}')
    return 0
