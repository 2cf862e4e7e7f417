"""Excite, record, identify: the commands of contour.md in a graph of real processes."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip('rclpy')

from stage_bringup.graph import Options, commands
from stage_bringup.processes import NodeCommand, Processes
from stage_core.ros.client_node import GraphClient
from stage_core.twin_file import TwinFile

from ..patience import PATIENCE

FRICTION = {
    'stribeck_friction.x': {'coulomb': 20.0, 'breakaway': 8.0, 'presliding': 4e-6},
    'stribeck_friction.y': {'coulomb': 8.0, 'breakaway': 2.0, 'presliding': 4e-6},
}
EXCITATION: dict[str, object] = {
    'use_sim_time': True,
    'half_range_x': 0.003,
    'half_range_y': 0.003,
    'speeds': [0.02, 0.06],
    'micro_time': 4.0,
    'multisine_time': 1.5,
    'lockstep_timeout': 60.0,
}


def test_friction_is_identified_from_a_recorded_session(
    ros_env: dict[str, str], tmp_path: Path
) -> None:
    reality = tmp_path / 'reality.yaml'
    TwinFile.nominal_servo().with_effects(FRICTION).save(reality)
    options = Options(out=tmp_path / 'out', reality=reality)
    graph = Processes(tmp_path / 'log')
    try:
        for command in commands(options):
            if command.name in ('stage_twin', 'stage_driver', 'session_recorder'):
                graph.start(command)
        with GraphClient('friction_test', use_sim_time=True) as client:
            for service in ('/stage_driver/home', '/session_recorder/start'):
                client.wait_for_service(service, PATIENCE)
            # The driver looks a minute for its drive; a plant that compiles takes longer.
            client.wait_for(
                lambda: client.node.get_clock().now().nanoseconds > 0, PATIENCE, 'a plant'
            )
            client.trigger('/stage_driver/home', PATIENCE)
            client.trigger('/session_recorder/start', PATIENCE)
            excite = NodeCommand('excite', 'contour_ctrl.excite_node', EXCITATION)
            done = subprocess.run(
                excite.arguments(),
                env=os.environ.copy(),
                stdin=subprocess.DEVNULL,
                capture_output=True,
                text=True,
            )
            assert done.returncode == 0, done.stdout + done.stderr
            client.trigger('/session_recorder/stop', PATIENCE)
    finally:
        graph.end()
    found = subprocess.run(
        [
            sys.executable,
            '-m',
            'contour_ctrl.identify_friction',
            '--bag',
            str(tmp_path / 'out' / 'session'),
        ],
        capture_output=True,
        text=True,
    )
    assert found.returncode == 0, found.stdout + found.stderr
    values = {
        name: float(value.split()[0])
        for name, value in (
            line.strip().split(': ') for line in found.stdout.splitlines() if line.startswith(' ')
        )
    }
    assert values['x.coulomb'] == pytest.approx(20.0, rel=0.03)
    assert values['y.coulomb'] == pytest.approx(8.0, rel=0.03)
    assert values['x.static'] == pytest.approx(28.0, rel=0.05)
    assert values['x.stiffness'] == pytest.approx(28.0 / 4e-6, rel=0.3)
