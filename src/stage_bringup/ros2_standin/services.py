"""``ros2 node list`` and ``ros2 service list|call``."""

from __future__ import annotations

import argparse

from ros2_standin.graph_node import Looker, full_name, print_names
from ros2_standin.messages import fill, interface
from stage_core.errors import StageError

#: Longest wait for the answer of a service [s]: a training takes minutes.
_LONGEST_CALL = 3600.0


def add_node_verbs(parser: argparse.ArgumentParser) -> None:
    """Declare the verbs of ``ros2 node``."""
    verbs = parser.add_subparsers(dest='verb', required=True, metavar='verb')
    verb = verbs.add_parser('list', help='Output a list of available nodes')
    verb.set_defaults(run=list_nodes)


def add_service_verbs(parser: argparse.ArgumentParser) -> None:
    """Declare the verbs of ``ros2 service``."""
    verbs = parser.add_subparsers(dest='verb', required=True, metavar='verb')
    verb = verbs.add_parser('list', help='Output a list of available services')
    verb.add_argument('-t', '--show-types', action='store_true')
    verb.set_defaults(run=list_services)
    verb = verbs.add_parser('call', help='Call a service')
    verb.add_argument('service_name')
    verb.add_argument('service_type')
    verb.add_argument('values', nargs='?', default='{}')
    verb.set_defaults(run=call_service)


def list_nodes(_: argparse.Namespace) -> None:
    """Print the nodes' names."""
    with Looker() as looker:
        looker.settle()
        for name in looker.nodes():
            print(name)


def list_services(arguments: argparse.Namespace) -> None:
    """Print the services' names."""
    print_names(lambda node: node.get_service_names_and_types(), arguments.show_types)


def call_service(arguments: argparse.Namespace) -> None:
    """Call a service and print request and response."""
    kind = interface(arguments.service_type, 'srv')
    request = fill(kind.Request(), arguments.values)
    name = full_name(arguments.service_name)
    with Looker() as looker:
        print(f'requester: making request: {request!r}\n', flush=True)
        try:
            response = looker.call(kind, name, request, _LONGEST_CALL)
        except StageError as error:
            raise StageError(f'{name} is not available: {error}') from None
    print(f'response:\n{response!r}\n')
