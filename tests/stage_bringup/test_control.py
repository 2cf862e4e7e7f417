"""Driver and contour controller in one process: the same numbers, topics and services."""

from __future__ import annotations

from pathlib import Path

from sensor_msgs.msg import JointState

from stage_bringup.graph import Options, commands
from stage_bringup.processes import Processes
from stage_core import topics
from stage_core.ros.client_node import GraphClient
from stage_core.ros.node import STATE_QOS, stamp_of

from ..patience import PATIENCE

WANTED = {'stage_twin', 'stage_driver', 'contour_ctrl', 'control'}
#: A contour of 0.7 s, twice: it learns in between.
CONTOUR = {'radius': 0.002, 'feed': 0.02, 'iterations': 2, 'scheme': 'cccmac+rilc'}


def lockstep_run(out: Path, is_composed: bool) -> tuple[str, dict[str, list], set[str]]:
    """The answer of ~/run, what each topic said, and the services of the two nodes."""
    options = Options(out=out, composed=is_composed)
    heard: dict[str, list] = {}
    with_services: set[str] = set()
    processes = Processes(out / 'log')
    try:
        for command in commands(options):
            if command.name in WANTED:
                processes.start(command)
        with GraphClient('judge', use_sim_time=True) as client:
            for topic in (topics.SETPOINT, topics.REFERENCE, topics.COMMAND, topics.JOINT_STATES):
                rows = heard.setdefault(topic, [])
                client.watch(
                    JointState,
                    topic,
                    STATE_QOS,
                    lambda m, rows=rows: rows.append(
                        (stamp_of(m.header), *m.position, *m.velocity, *m.effort)
                    ),
                )
            for service in ('/stage_driver/home', '/contour_ctrl/run'):
                client.wait_for_service(service, PATIENCE, processes.check)
            client.trigger('/stage_driver/home', PATIENCE)
            client.set_parameters('/contour_ctrl', **CONTOUR)
            answer = client.trigger('/contour_ctrl/run', PATIENCE)
            client.wait_until_quiet(topics.JOINT_STATES, 1.0, 30.0)
            with_services = {
                name
                for node in ('stage_driver', 'contour_ctrl')
                for name, _ in client.node.get_service_names_and_types_by_node(node, '/')
            }
    finally:
        assert processes.end() == []
    return answer, heard, with_services


def test_one_process_and_two_give_the_same_numbers(
    tmp_path: Path, ros_env: dict[str, str]
) -> None:
    apart = lockstep_run(tmp_path / 'apart', False)
    composed = lockstep_run(tmp_path / 'composed', True)
    assert 'best, iteration 2' in apart[0]
    assert composed[0] == apart[0]
    assert composed[2] == apart[2]
    for topic in (topics.REFERENCE, topics.COMMAND, topics.JOINT_STATES):
        assert len(apart[1][topic]) > 1500
        assert composed[1][topic] == apart[1][topic], topic
    # Where the clock stands when the move to the start is sent is not part of the tick.
    streams = [
        [row for row in heard[topics.SETPOINT] if len(row) == 5]
        for _, heard, _ in (apart, composed)
    ]
    assert len(streams[0]) > 1000 and streams[0] == streams[1]
