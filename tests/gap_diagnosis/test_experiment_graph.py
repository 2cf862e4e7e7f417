"""`~/experiment` in a graph of real processes in lockstep: refused, run, stopped."""

from __future__ import annotations

import json
import re
import threading
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='ROS 2 is not installed')

from sensor_msgs.msg import JointState

from gap_diagnosis.experiment.motions import Limits, Motion, sample
from gap_diagnosis.experiment.travel import FILE
from gap_diagnosis.report.experiment import table
from session_bags.writer import write_session
from stage_bringup.graph import Options, commands
from stage_bringup.processes import NodeCommand, Processes
from stage_core import topics
from stage_core.errors import StageError
from stage_core.ros.client_node import GraphClient
from stage_core.ros.node import SETPOINT_QOS
from stage_core.session import Session
from stage_core.twin_file import TwinFile

from ..patience import PATIENCE

FRICTION = {'coulomb_friction.x': {'coulomb': 15.0, 'presliding': 4e-6}}
NODES = ('stage_twin', 'stage_driver', 'session_recorder', 'contour_ctrl')
SERVICE = '/gap_diagnosis/experiment'


def open_report(folder: Path, duration: float, bag: Path, twin: Path) -> None:
    """What a diagnosis leaves that asks for an experiment of so many seconds."""
    folder.mkdir()
    limits = Limits(np.full(2, -0.01), np.full(2, 0.01), np.full(2, 600.0))
    motion = sample(Motion('strokes', 0.9, 0.7, (0.5, 0.5), 0), limits, duration, 0.001)
    (folder / FILE).write_text(table(motion, 0.001, ('x', 'y')), encoding='utf-8')
    asked = {'separates': ['coulomb_friction.x', 'force_offset.x'], 'duration': duration}
    of = {'session': str(bag), 'twin': str(twin)}
    report = {**of, 'verdict': ['force_offset.x'], 'experiment': asked}
    (folder / 'report.json').write_text(json.dumps(report), encoding='utf-8')


def test_the_experiment_is_refused_then_run_and_stopped(
    planted: Callable[..., Session], ros_env: dict[str, str], tmp_path: Path
) -> None:
    reality, nominal = tmp_path / 'reality.yaml', tmp_path / 'nominal.yaml'
    TwinFile.nominal_servo().with_effects(FRICTION).save(reality)
    TwinFile.nominal_servo().save(nominal)
    first = planted(FRICTION, axes=('x', 'y'), duration=8.5)
    del first.series[topics.TRACKER_POINT]
    out = tmp_path / 'report'
    bag = write_session(tmp_path / 'first', first)
    open_report(out, 5.0, bag, nominal)
    asker = NodeCommand(
        'gap_diagnosis',
        'gap_diagnosis.node',
        {
            'use_sim_time': True,
            'live': False,
            'twin': nominal,
            'bag': bag,
            'out': out,
        },
    )
    options = Options(out=tmp_path / 'out', reality=reality, nominal=nominal)
    graph = Processes(tmp_path / 'log')
    streaming = threading.Event()
    failures: list[str] = []

    def streamed(message: JointState) -> None:
        if message.velocity:
            streaming.set()

    try:
        for command in [c for c in commands(options) if c.name in NODES] + [asker]:
            graph.start(command)
        with GraphClient('experiment_test', use_sim_time=True) as client:
            for service in ('/stage_driver/home', '/contour_ctrl/run', SERVICE):
                client.wait_for_service(service, PATIENCE, graph.check)
            with pytest.raises(StageError, match='allow_motion'):
                client.trigger(SERVICE, PATIENCE)
            client.set_parameters('gap_diagnosis', allow_motion=True)
            with pytest.raises(StageError, match='not homed'):
                client.trigger(SERVICE, PATIENCE)
            client.trigger('/stage_driver/home', PATIENCE)
            for name, other, told in (
                ('travel', 'x:-0.001:0.001', 'beyond the travel'),
                ('twin', str(reality), 'of another bag or twin'),
            ):
                client.set_parameters('gap_diagnosis', **{name: other})
                with pytest.raises(StageError, match=told):
                    client.trigger(SERVICE, PATIENCE)
            client.set_parameters('gap_diagnosis', travel='', twin=str(nominal))

            message = client.trigger(SERVICE, PATIENCE)
            assert 'before: force_offset.x' in message
            assert re.search(
                r': Coulomb friction of x \(p [01]\.\d\d\): the held-out gap shrinks', message
            )
            report = json.loads((out / 'report.json').read_text(encoding='utf-8'))
            assert report['verdict'] == ['coulomb_friction.x']
            assert (tmp_path / 'out' / 'experiment' / 'metadata.yaml').is_file()

            report.pop('experiment', None)  # that of what both sessions hide
            (out / 'report.json').write_text(json.dumps(report), encoding='utf-8')
            with pytest.raises(StageError, match='nothing open'):
                client.trigger(SERVICE, PATIENCE)
            out.rename(tmp_path / 'answered')
            # No machine is done with it before the stop comes.
            open_report(out, 120.0, bag, nominal)
            client.watch(JointState, topics.SETPOINT, SETPOINT_QOS, streamed)

            def ask() -> None:
                with GraphClient('second_asker') as other, pytest.raises(StageError) as failed:
                    other.trigger(SERVICE, PATIENCE)
                failures.append(str(failed.value))

            asking = threading.Thread(target=ask)
            asking.start()
            assert streaming.wait(PATIENCE)
            # It would move the stage later, when nobody waits for it any more.
            with pytest.raises(StageError, match='under way'):
                client.trigger(SERVICE, PATIENCE)
            client.trigger('/stage_driver/stop', PATIENCE)
            asking.join(PATIENCE)
            assert failures and '/contour_ctrl/run failed' in failures[0]
    finally:
        assert graph.end() == []
