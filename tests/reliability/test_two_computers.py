"""Plant and driver on one computer, the rest on another: delay, loss, and a cable that is cut."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest

from session_bags.check import check_bag
from session_bags.reader import read_session
from stage_bringup.graph import Options, commands
from stage_core import topics

from ..domains import own_domain
from .computers import ADDRESSES, NAMES, Cable, On, forwarded, two_computers
from .rig import Nodes

STAGE = ('stage_twin', 'stage_driver')
ROOT = Path(__file__).resolve().parents[2]
#: K_p of 10 1/s bears a delay of 20 ms there and 20 ms back, that of the default would not.
OWN: dict[str, dict[str, object]] = {
    'tracker_bridge': {'host': ADDRESSES[0]},
    'gap_diagnosis': {'live': False},
    'contour_ctrl': {
        'iterations': 1, 'scheme': 'p_ff', 'feed': 0.01, 'missed_share': 0.5,
        'x.position_gain': 10.0, 'y.position_gain': 10.0,
    },
}  # fmt: skip


def test_a_cut_cable_brings_the_stage_to_rest_and_the_graph_heals(tmp_path: Path) -> None:
    with ExitStack() as stack:
        stack.enter_context(
            # Other tests of the run may have chosen a profile that stays on this machine.
            own_domain(
                ROS_AUTOMATIC_DISCOVERY_RANGE='SUBNET',
                FASTDDS_BUILTIN_TRANSPORTS='UDPv4',
                FASTRTPS_DEFAULT_PROFILES_FILE=None,
            )
        )
        try:
            cable = stack.enter_context(two_computers(delay=0.02, loss=0.01))
        except (OSError, subprocess.CalledProcessError) as error:
            pytest.skip(f'network namespaces are not permitted here: {error}')
        chosen = []
        for command in commands(Options(clock='realtime', out=tmp_path / 'out')):
            where = NAMES[0] if command.name in STAGE else NAMES[1]
            parameters = {**command.parameters, **OWN.get(command.name, {})}
            chosen.append(
                On(command.name, command.module, parameters, command.parameter_files, where)
            )
            if command.name == 'tracker_bridge':
                stack.enter_context(forwarded(int(str(parameters['port']))))
        nodes = Nodes(chosen, tmp_path / 'log')
        try:
            nodes.run()
            lines = visit(nodes, cable)
        finally:
            nodes.end()
    assert float(lines['rest']) < 2e-5
    # The publisher repeats its last 1000 messages; where that is not all, the bag tells the gap.
    told = ' '.join(f.text for f in check_bag(lines['bag']) if f.about == topics.JOINT_STATES)
    stamps = read_session(lines['bag']).series[topics.JOINT_STATES].stamps
    assert f'gaps, the longest of {1e-9 * np.diff(stamps).max():.3f} s' in told


def visit(nodes: Nodes, cable: Cable) -> dict[str, str]:
    """Run the user on the second computer; the last word of each line it prints."""
    user = subprocess.Popen(
        ['ip', 'netns', 'exec', NAMES[1], sys.executable, '-m', 'tests.reliability.visitor'],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=ROOT, env=os.environ,
    )  # fmt: skip
    assert user.stdin is not None and user.stdout is not None
    found: dict[str, str] = {}
    try:
        for line in user.stdout:
            word, _, value = line.strip().partition(' ')
            found[word] = value
            if word == 'moving':
                cable.cut()
                time.sleep(5.0)
                cable.join()
                user.stdin.write('\n')
                user.stdin.flush()
        assert user.wait() == 0, {n: nodes.log(n)[-1500:] for n in nodes.commands}
        assert nodes.dead() == []
    finally:
        if user.poll() is None:
            user.kill()
            user.wait()
    return found
