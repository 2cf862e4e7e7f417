"""Who can reach the graph, and what a parameter can write."""

from __future__ import annotations

import ipaddress
import os
import re
import shutil
import socket
import struct
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest

from stage_bringup import live_view_node
from stage_bringup.client_node import SessionClient
from stage_core import topics
from stage_core.errors import StageError
from stage_core.ros.peers import PEERS, SILENCE, PeerWatch

from .rig import Nodes, Watch

ROOT = Path(__file__).resolve().parents[2]
SECURITY = ROOT / 'ros_ws' / 'config' / 'security'
NODES = (
    'stage_twin',
    'stage_driver',
    'tracker_bridge',
    'session_recorder',
    'calibrator',
    'contour_ctrl',
    'gap_diagnosis',
)


@pytest.fixture(scope='module')
def emulators(graph: Callable[..., Any]) -> Iterator[tuple[Nodes, Watch]]:
    """The plant with its emulated devices, the driver, and the nodes that write files."""
    with graph(*NODES) as (nodes, watch):
        # Not for a measurement: in lockstep the first one is the only one until somebody moves.
        for name in NODES:
            watch.wait(lambda name=name: watch.heard(name), name)
        yield nodes, watch


def bound(pid: int) -> list[tuple[str, str, int]]:
    """Protocol, local address and port of every IPv4 and IPv6 socket of a process that listens."""
    inodes = set()
    for entry in Path(f'/proc/{pid}/fd').iterdir():
        try:
            found = re.fullmatch(r'socket:\[(\d+)\]', os.readlink(entry))
        except OSError:
            continue
        if found:
            inodes.add(found[1])
    rows = []
    for protocol in ('tcp', 'udp', 'tcp6', 'udp6'):
        for line in Path(f'/proc/{pid}/net/{protocol}').read_text().splitlines()[1:]:
            fields = line.split()
            listening = protocol.startswith('udp') or fields[3] == '0A'
            if fields[9] not in inodes or not listening:
                continue
            address, port = fields[1].split(':')
            words = [int(address[i : i + 8], 16) for i in range(0, len(address), 8)]
            raw = b''.join(struct.pack('=I', word) for word in words)
            rows.append((protocol, str(ipaddress.ip_address(raw)), int(port, 16)))
    return rows


def test_the_reader_of_proc_sees_an_open_socket() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(('0.0.0.0', 0))
        assert ('udp', '0.0.0.0', probe.getsockname()[1]) in bound(os.getpid())


def test_emulators_listen_on_loopback_only(emulators: tuple[Nodes, Watch]) -> None:
    nodes, _ = emulators
    parameters = nodes.commands['stage_twin'].parameters
    ports = {int(str(parameters['drive_port'])), int(str(parameters['tracker_port']))}
    rows = bound(nodes.running['stage_twin'].pid)
    mine = [row for row in rows if row[2] in ports]
    assert {row[2] for row in mine} == ports
    assert all(ipaddress.ip_address(row[1]).is_loopback for row in mine), mine
    # No node offers a TCP port to anybody else.
    for process in nodes.running.values():
        for protocol, address, _port in bound(process.pid):
            if protocol.startswith('tcp'):
                assert ipaddress.ip_address(address).is_loopback, (protocol, address)


def chosen(**environment: str) -> list[str]:
    """Discovery range and Fast DDS profile that a node takes in an environment."""
    names = ('ROS_AUTOMATIC_DISCOVERY_RANGE', 'FASTRTPS_DEFAULT_PROFILES_FILE')
    script = (
        'import os\n'
        'from stage_core.ros.node import local_graph\n'
        # Another middleware need not be installed here: rclpy has been imported.
        f'os.environ.update({environment})\n'
        'local_graph()\n'
        f'print(*(os.environ.get(name, "none") for name in {names}))\n'
    )
    bare = {k: v for k, v in os.environ.items() if k not in (*names, 'RMW_IMPLEMENTATION')}
    done = subprocess.run([sys.executable, '-c', script], env=bare, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


def test_the_graph_stays_on_this_machine(emulators: tuple[Nodes, Watch]) -> None:
    """Every node chooses this machine by itself: nothing in the environment asks for it."""
    nodes, watch = emulators
    for asked in ({}, {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}):
        reach, profile = chosen(**asked)
        # The profile says what LOCALHOST means; the middleware must add nothing of its own.
        assert reach == 'SYSTEM_DEFAULT'
        assert Path(profile).name == 'fastdds_local.xml'
    assert chosen(RMW_IMPLEMENTATION='rmw_cyclonedds_cpp') == ['LOCALHOST', 'none']
    # What is asked for on purpose is kept.
    own = '/etc/own_profile.xml'
    assert chosen(FASTRTPS_DEFAULT_PROFILES_FILE=own) == ['LOCALHOST', own]
    assert chosen(ROS_AUTOMATIC_DISCOVERY_RANGE='SUBNET') == ['SUBNET', 'none']
    # Discovery announces itself to the multicast group on the loopback interface only.
    for name, process in nodes.running.items():
        joined = _multicast_interfaces(process.pid)
        assert joined <= {'lo'}, f'{name} announces itself on {joined}'
    assert watch.client.node.count_subscribers(topics.SETPOINT) > 0


def _multicast_interfaces(pid: int) -> set[str]:
    """Interfaces on which the machine has joined FastDDS' discovery group 239.255.0.1."""
    group = ''.join(f'{octet:02X}' for octet in reversed((239, 255, 0, 1)))
    joined, interface = set(), ''
    for line in Path(f'/proc/{pid}/net/igmp').read_text().splitlines()[1:]:
        fields = line.split()
        if fields[0].isdigit():
            interface = fields[1].rstrip(':')
        elif fields[0] == group:
            joined.add(interface)
    return joined


@pytest.mark.parametrize(
    ('node', 'parameter'),
    [
        ('session_recorder', 'directory'),
        ('calibrator', 'model_folder'),
        ('contour_ctrl', 'session_folder'),
        ('gap_diagnosis', 'out'),
    ],
)
def test_the_graph_cannot_move_where_nodes_write(
    emulators: tuple[Nodes, Watch], tmp_path: Path, node: str, parameter: str
) -> None:
    _, watch = emulators
    outside = tmp_path / 'outside'
    with pytest.raises(StageError, match='read-only|read only|read_only'):
        watch.client.set_parameters(f'/{node}', **{parameter: str(outside)})
    assert not outside.exists()


@pytest.mark.parametrize('name', ['../outside', '/tmp/outside', '..', 'a/b', '', '.hidden'])
def test_a_bag_cannot_leave_its_folder(emulators: tuple[Nodes, Watch], name: str) -> None:
    _, watch = emulators
    with pytest.raises(StageError, match='letters, digits'):
        watch.client.set_parameters('/session_recorder', name=name)


def test_peers_that_fall_silent_are_named() -> None:
    now = [0.0]
    watch = PeerWatch(('stage_driver', 'tracker_bridge'), clock=lambda: now[0])
    watch.hear('stage_driver')
    watch.hear('calibrator')
    now[0] = SILENCE
    assert watch.status()[0] and watch.silent() == []
    now[0] = SILENCE + 0.1
    well, text, values = watch.status()
    assert not well and text == 'stage_driver fell silent: start it again'
    assert values['tracker_bridge'] == 'not heard yet'
    watch.hear('stage_driver')
    assert watch.silent() == []


def test_two_processes_that_speak_by_turns_are_named() -> None:
    now, real = [0.0], [True]
    watch = PeerWatch((), lambda _: real[0], lambda: now[0])

    def say(*processes: str) -> list[str]:
        told = []
        for process in processes:
            now[0] += 0.5
            told.append(watch.hear('stage_driver', process))
        return [text for text in told if text]

    assert say('a', 'a', 'b', 'b', 'b') == []  # started again
    (told,) = say('c', 'b', 'c')
    assert 'two stage_driver speak' in told and 'b and c: end one graph' in told
    assert watch.status()[:2] == (False, told)
    now[0] += SILENCE
    assert watch.status()[0]
    real[0] = False  # a replayed bag
    assert say('c', 'd', 'c', 'd') == [] and watch.status()[0]


def test_every_node_has_a_watcher() -> None:
    watched = {peer for peers in PEERS.values() for peer in peers}
    # The plant is missed on its wires, by the driver and the bridge.
    assert watched == set(NODES) - {'stage_twin'}


def allowed(profile: ElementTree.Element, verb: str) -> set[str]:
    """Full names of the topics or services that a profile allows."""
    names = set()
    for block in profile:
        if block.get(verb) == 'ALLOW':
            for entry in block:
                text = (entry.text or '').strip()
                home = f'/{profile.get("node")}/'
                names.add(text.replace('~/', home) if '~' in text else '/' + text.strip('/'))
    return names


def profile_of(node: str) -> ElementTree.Element:
    """What a node may do."""
    tree = ElementTree.parse(SECURITY / 'policies.xml')
    return next(p for p in tree.iter('profile') if p.get('node') == node)


@pytest.mark.parametrize('node', NODES)
def test_policies_allow_what_the_running_graph_does(
    emulators: tuple[Nodes, Watch], node: str
) -> None:
    profile = profile_of(node)
    client = emulators[1].client.node
    for verb, known in (
        ('publish', client.get_publisher_names_and_types_by_node),
        ('subscribe', client.get_subscriber_names_and_types_by_node),
        ('reply', client.get_service_names_and_types_by_node),
    ):
        used = {name for name, _ in known(node, '/')}
        assert used or verb == 'subscribe', f'{node} has nothing to {verb}'
        assert used <= allowed(profile, verb), (verb, used - allowed(profile, verb))


def test_policies_allow_what_a_session_asks_for(emulators: tuple[Nodes, Watch]) -> None:
    profile = profile_of('session')
    with SessionClient(0.6, use_sim_time=True) as client:
        node = client.node
        heard = {name for name, _ in node.get_subscriber_names_and_types_by_node('session', '/')}
        said = {name for name, _ in node.get_publisher_names_and_types_by_node('session', '/')}
    assert topics.TARGET in said
    assert heard <= allowed(profile, 'subscribe') and said <= allowed(profile, 'publish')
    sources = [p.read_text() for p in (ROOT / 'src' / 'stage_bringup').rglob('*.py')]
    services = set(re.findall(r"'(/(?!dev/)\w+/\w+)'", ''.join(sources)))
    services |= {
        f'{node}/set_parameters'
        for node in re.findall(r"parameters\(\s*'(/\w+)'", ''.join(sources))
    }
    assert '/stage_driver/home' in services and '/session_recorder/set_parameters' in services
    assert services - topics.TOPIC_TYPES.keys() <= allowed(profile, 'request')


def executables() -> set[str]:
    """Executables of the workspace that are nodes: their module ends in `node`."""
    found = set()
    for setup in (ROOT / 'src').glob('*/setup.py'):
        found |= set(re.findall(r"'(\w+) = [\w.]*node:main'", setup.read_text()))
    return found


def test_policies_name_every_node_and_what_moves_the_stage() -> None:
    tree = ElementTree.parse(SECURITY / 'policies.xml')
    profiles = {p.get('node'): p for p in tree.iter('profile')}
    assert {*NODES, 'excite', 'session_player', 'live_view'} <= executables() <= set(profiles)
    # A node whose topics are one list in its module; the others are compared while they run.
    assert set(live_view_node.SHOWN) <= allowed(profiles['live_view'], 'subscribe')
    offered = topics.TOPIC_TYPES.keys() - {topics.SETPOINT, topics.TARGET, topics.DIAGNOSTICS}
    assert offered <= allowed(profiles['session_player'], 'publish')
    movers = {name for name in profiles if '/stage/setpoint' in allowed(profiles[name], 'publish')}
    # Nobody else may publish set-points.
    assert movers == {'calibrator', 'contour_ctrl', 'excite'}
    for name in set(profiles) - {'stage_driver'}:
        for block in profiles[name].iter('services'):
            if block.get('reply') == 'ALLOW':
                assert not any('stage_driver' in (s.text or '') for s in block)


@pytest.mark.parametrize('keys', ['no keystore', 'no keys'])
def test_a_node_without_its_keys_does_not_start(
    ros_env: dict[str, str], tmp_path: Path, keys: str
) -> None:
    keystore = tmp_path / 'keystore'
    if keys == 'no keys':
        (keystore / 'enclaves' / 'stage_driver').mkdir(parents=True)
    done = subprocess.run(
        [sys.executable, '-m', 'stage_driver.node', '--ros-args', '--enclave', '/stage_driver'],
        env={
            **ros_env,
            'ROS_SECURITY_ENABLE': 'true',
            'ROS_SECURITY_STRATEGY': 'Enforce',
            'ROS_SECURITY_KEYSTORE': str(keystore),
        },
        capture_output=True,
        text=True,
    )
    assert done.returncode == 2, done.stderr
    # ROS may log where it looked; the node adds one line.
    (line,) = [text for text in done.stderr.splitlines() if text.startswith('error: ')]
    assert 'security' in line.lower() and 'Traceback' not in done.stderr


def test_policies_are_enforced_by_ros(tmp_path: Path) -> None:
    if shutil.which('ros2') is None:
        pytest.skip('no ros2 command: SROS 2 needs a full ROS 2 installation')
    known = subprocess.run(['ros2', 'security', '--help'], capture_output=True, text=True)
    if known.returncode != 0:
        pytest.skip('ros2 security is absent: SROS 2 needs a full ROS 2 installation')
    keystore = tmp_path / 'keystore'
    subprocess.run(['ros2', 'security', 'create_keystore', str(keystore)], check=True)
    subprocess.run(
        ['ros2', 'security', 'generate_artifacts', '-k', str(keystore)]
        + ['-p', str(SECURITY / 'policies.xml')],
        check=True,
    )
    for node in NODES:
        enclave = keystore / 'enclaves' / node
        assert (enclave / 'permissions.p7s').is_file(), node
