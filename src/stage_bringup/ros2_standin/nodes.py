"""``ros2 node list|info`` and ``ros2 service list|type|call``."""

from __future__ import annotations

import argparse

from ros2_standin.graph_node import (
    add_list_options,
    answer,
    full_name,
    hidden,
    node,
    node_names,
    print_names,
    require_node,
    settle,
    split_name,
    wait_for_type,
)
from ros2_standin.messages import fill, interface
from stage_core.errors import StageError


def add_node_verbs(parser: argparse.ArgumentParser) -> None:
    """Declare the verbs of ``ros2 node``."""
    verbs = parser.add_subparsers(dest='verb', required=True, metavar='verb')
    verb = verbs.add_parser('list', help='Output a list of available nodes')
    verb.add_argument('-a', '--all', action='store_true', help='Show hidden nodes too')
    verb.add_argument('-c', '--count-nodes', action='store_true')
    verb.add_argument('--spin-time', type=float)
    verb.set_defaults(run=list_nodes)
    verb = verbs.add_parser('info', help='Output information about a node')
    verb.add_argument('node_name')
    verb.set_defaults(run=node_info)


def add_service_verbs(parser: argparse.ArgumentParser) -> None:
    """Declare the verbs of ``ros2 service``."""
    verbs = parser.add_subparsers(dest='verb', required=True, metavar='verb')
    verb = verbs.add_parser('list', help='Output a list of available services')
    add_list_options(verb, 'services')
    verb.set_defaults(run=list_services)
    verb = verbs.add_parser('type', help="Output a service's type")
    verb.add_argument('service_name')
    verb.set_defaults(run=service_type)
    verb = verbs.add_parser('call', help='Call a service')
    verb.add_argument('service_name')
    verb.add_argument('service_type')
    verb.add_argument('values', nargs='?', default='{}')
    verb.set_defaults(run=call_service)


def list_nodes(arguments: argparse.Namespace) -> None:
    """Print the nodes' names."""
    with node() as looker:
        settle(looker, arguments.spin_time)
        names = node_names(looker, arguments.all)
    print(len(names) if arguments.count_nodes else '\n'.join(names), end='\n' if names else '')


def node_info(arguments: argparse.Namespace) -> None:
    """Print the topics and services of a node."""
    with node() as looker:
        try:
            full = require_node(looker, arguments.node_name)
        except StageError:
            raise StageError(f"Unable to find node '{full_name(arguments.node_name)}'") from None
        settle(looker)
        base = split_name(full)
        sections = {
            'Subscribers': looker.get_subscriber_names_and_types_by_node(*base),
            'Publishers': looker.get_publisher_names_and_types_by_node(*base),
            'Service Servers': looker.get_service_names_and_types_by_node(*base),
            'Service Clients': looker.get_client_names_and_types_by_node(*base),
        }
    print(full)
    for title, entries in sections.items():
        print(f'  {title}:')
        for name, types in sorted(entries):
            if not hidden(name):
                print(f'    {name}: {", ".join(types)}')
    print('  Action Servers:\n\n  Action Clients:\n')


def list_services(arguments: argparse.Namespace) -> None:
    """Print the services' names."""
    print_names(arguments, lambda looker: looker.get_service_names_and_types())


def service_type(arguments: argparse.Namespace) -> None:
    """Print a service's type."""
    name = full_name(arguments.service_name)
    with node() as looker:
        found = wait_for_type(
            looker.get_service_names_and_types,
            name,
            f'{name} is not available: is its node running?',
        )
    print(found)


def call_service(arguments: argparse.Namespace) -> None:
    """Call a service and print request and response."""
    kind = interface(arguments.service_type, 'srv')
    request = fill(kind.Request(), arguments.values)
    name = full_name(arguments.service_name)
    with node() as looker:
        client = looker.create_client(kind, name)
        if not client.wait_for_service(timeout_sec=1.0):
            print('waiting for service to become available...', flush=True)
            if not client.wait_for_service(timeout_sec=20.0):
                raise StageError(f'{name} is not available: is its node running?')
        print(f'requester: making request: {request!r}\n', flush=True)
        response = answer(client.call_async(request), name)
    print(f'response:\n{response!r}\n')
