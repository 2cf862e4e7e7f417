"""Live mode in a graph of real processes, on a timed motion as an experiment is one."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='ROS 2 is not installed')

from diagnostic_msgs.msg import DiagnosticArray

from gap_diagnosis.experiment.motions import Limits, Motion, sample
from gap_diagnosis.experiment.travel import FILE
from gap_diagnosis.report.experiment import table
from stage_bringup.graph import Options, commands
from stage_bringup.processes import NodeCommand, Processes
from stage_core import topics
from stage_core.ros.client_node import GraphClient
from stage_core.twin_file import TwinFile

from ..patience import PATIENCE

CHANGED = {'coulomb_friction.x': {'coulomb': 25.0}, 'viscous_friction.y': {'viscous': 150.0}}
LIVE: dict[str, object] = {'live': True, 'window': 2.0, 'learn': 2}


def test_live_mode_warns_when_the_machine_is_another_one(
    ros_env: dict[str, str], tmp_path: Path
) -> None:
    limits = Limits(np.full(2, -0.02), np.full(2, 0.02), np.full(2, 600.0))
    motion = sample(Motion('strokes', 0.95, 0.7, (0.5, 0.5), 3), limits, 9.0, 0.001)
    curve = tmp_path / FILE
    curve.write_text(table(motion, 0.001, ('x', 'y')), encoding='utf-8')
    first, second = tmp_path / 'first.yaml', tmp_path / 'second.yaml'
    TwinFile.nominal_servo().save(first)
    TwinFile.nominal_servo().with_effects(CHANGED).save(second)
    nodes = {c.name: c for c in commands(Options(out=tmp_path / 'out', reality=first))}
    plant = nodes['stage_twin']
    changed = replace(plant, parameters={**plant.parameters, 'twin': second})
    diagnosis = nodes['gap_diagnosis']
    watcher = replace(diagnosis, parameters={**diagnosis.parameters, **LIVE})
    said: list[str] = []
    watching = Processes(tmp_path / 'watching')

    def heard(message: DiagnosticArray) -> None:
        said.extend(s.message for s in message.status if s.name == 'gap_diagnosis: gap')

    def run(machine: NodeCommand, log: str, until: str) -> None:
        """Follow the experiment on a machine until live mode says something of it."""
        graph = Processes(tmp_path / log)
        try:
            for command in (machine, nodes['stage_driver'], nodes['contour_ctrl']):
                graph.start(command)
            with GraphClient(f'{log}_client', use_sim_time=True) as client:
                client.watch(DiagnosticArray, topics.DIAGNOSTICS, callback=heard)
                for service in ('/stage_driver/home', '/contour_ctrl/run'):
                    client.wait_for_service(service, PATIENCE, graph.check)
                client.trigger('/stage_driver/home', PATIENCE)
                client.set_parameters(
                    'contour_ctrl',
                    contour='timed',
                    curve_file=str(curve),
                    iterations=1,
                    scheme='p_ff',
                )
                message = client.trigger('/contour_ctrl/run', PATIENCE)
                assert 'tracking RMS' in message
                client.wait_for(lambda: any(until in m for m in said), PATIENCE, until)
        finally:
            graph.end()

    try:
        watching.start(watcher)
        run(plant, 'first', 'within its band')
        assert not any('left its band' in m for m in said), said
        said.clear()
        run(changed, 'second', 'left its band')
        watching.check()
    finally:
        assert watching.end() == []
    warning = next(m for m in said if 'left its band' in m)
    assert 'encoder.x' in warning and 'diagnose a session' in warning
