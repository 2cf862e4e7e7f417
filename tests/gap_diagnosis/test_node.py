"""The node answers ~/diagnose with the verdict, and a bad request with the reason."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from session_bags.writer import write_session
from stage_core.errors import StageError
from stage_core.session import Session
from stage_core.twin_file import TwinFile

from ..node_process import end, node, start
from ..patience import PATIENCE

pytest.importorskip('rclpy', reason='ROS 2 is not installed')

from stage_core.ros.client_node import GraphClient

Maker = Callable[..., Session]


def test_the_service_answers_with_the_verdict(
    planted: Maker, tmp_path: Path, ros_env: dict[str, str]
) -> None:
    bag = write_session(tmp_path / 'bag', planted({'backlash.x': {'width': 9e-6}}, duration=12.0))
    TwinFile.nominal_servo().save(tmp_path / 'twin.yaml')
    values = {'bag': bag, 'twin': tmp_path / 'twin.yaml', 'out': tmp_path / 'out'}
    with node('gap_diagnosis.node', ros_env, **values) as process, GraphClient() as client:
        client.wait_for_service('/gap_diagnosis/diagnose', timeout=PATIENCE)
        message = client.trigger('/gap_diagnosis/diagnose', timeout=PATIENCE)
        assert message.startswith('backlash of x (p 0.')
        assert (tmp_path / 'out' / 'report.json').exists()
        client.set_parameters('gap_diagnosis', bag=str(tmp_path / 'nowhere'))
        with pytest.raises(StageError, match='nowhere'):
            client.trigger('/gap_diagnosis/diagnose', timeout=PATIENCE)
    assert process.returncode == 0


def test_live_mode_refuses_or_leaves_out_a_twin_without_a_servo_loop(
    tmp_path: Path, ros_env: dict[str, str]
) -> None:
    rig, stepper = tmp_path / 'rig.yaml', tmp_path / 'stepper.yaml'
    rig.write_text('kind: measured_force\naxes: {x: {mass: 95.1}}\n')
    stepper.write_text('kind: stepper\naxes: {x: {}, y: {}}\n')
    refused = start('gap_diagnosis.node', ros_env, twin=rig)
    (line,) = refused.communicate()[0].strip().splitlines()
    assert refused.returncode == 2 and 'measured_force' in line
    process = start('gap_diagnosis.node', ros_env, twin=stepper)
    with GraphClient() as client:
        client.wait_for_service('/gap_diagnosis/diagnose', timeout=PATIENCE)
    assert 'live mode is off' in end(process)
    assert process.returncode == 0
