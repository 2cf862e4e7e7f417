"""The driver as a real process, before a real twin process and without one."""

import re
import threading
import time
from pathlib import Path

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from stage_core import topics
from stage_core.errors import StageError
from stage_core.ros.client_node import GraphClient
from stage_core.ros.node import SETPOINT_QOS, joint_state, stamp_of
from stage_twin.emulators.zaber_pty import ZaberPty

from ..node_process import node, start
from ..patience import PATIENCE
from .driver_rig import SmallPlant
from .zaber_rig import chain

CONFIG = Path(__file__).resolve().parents[2] / 'ros_ws' / 'config' / 'stage_driver_servo.yaml'
DRIVER = 'stage_driver.node'


def statuses(message):
    return {status.name: status for status in message.status}


def test_servo_node_homes_stops_at_once_and_reports_refusals(ros_env):
    plant = SmallPlant(lockstep=False, start=(0.1, 0.05))
    plant.start()
    try:
        # The drive is a thread of this process, which a busy machine may leave waiting.
        driver = node(DRIVER, ros_env, CONFIG, drive_port=plant.port, link_timeout=PATIENCE)
        with driver, GraphClient('test_client') as client:
            for topic in (topics.REFERENCE, topics.COMMAND, topics.JOINT_STATES):
                client.watch(JointState, topic)
            client.watch(DiagnosticArray, topics.DIAGNOSTICS)
            client.wait_for(
                lambda: client.latest(topics.COMMAND) is not None, PATIENCE, 'commands'
            )
            setpoints = client.node.create_publisher(JointState, topics.SETPOINT, SETPOINT_QOS)
            homing = []

            def home():
                try:
                    homing.append(client.trigger('/stage_driver/home', PATIENCE))
                except Exception as error:
                    homing.append(str(error))

            # Found before homing starts: discovery may take longer than homing.
            stop = client.node.create_client(Trigger, '/stage_driver/stop')
            assert stop.wait_for_service(PATIENCE)
            thread = threading.Thread(target=home)
            thread.start()
            client.wait_for(lambda: plant.position[0] < 0.095, PATIENCE, 'homing')
            # `~/stop` is served while `~/home` still waits for its answer.
            answer = stop.call_async(Trigger.Request())
            client.wait_for(answer.done, PATIENCE, 'the answer of ~/stop')
            assert answer.result().message == 'stopping'
            thread.join(PATIENCE)
            assert 'homing ended: stopped by request' in homing[0]
            assert plant.position[0] > 0.01
            assert client.trigger('/stage_driver/home', PATIENCE).startswith('homed')
            measured = client.latest(topics.JOINT_STATES)
            assert measured.name == ['x', 'y'] and abs(measured.position[0]) < 1e-5
            assert len(client.latest(topics.COMMAND).effort) == 2
            assert client.latest(topics.REFERENCE).header.stamp.sec >= 1
            client.wait_for(lambda: setpoints.get_subscription_count() > 0, PATIENCE, 'the driver')
            setpoints.publish(joint_state(0, ['x', 'y'], [0.4, 0.0]))

            def refusal_shown():
                found = statuses(client.latest(topics.DIAGNOSTICS) or DiagnosticArray())
                status = found.get('stage_driver: set-points')
                return status is not None and 'position of x 0.400000 m' in status.message

            client.wait_for(refusal_shown, PATIENCE, 'the refusal on /diagnostics')
            assert abs(client.latest(topics.JOINT_STATES).position[0]) < 1e-5

            rivals = [setpoints]
            rivals.append(client.node.create_publisher(JointState, topics.SETPOINT, SETPOINT_QOS))
            client.wait_for(lambda: rivals[1].get_subscription_count() > 0, PATIENCE, 'the driver')

            def rivals_shown():
                stamp = stamp_of(client.latest(topics.JOINT_STATES).header)
                for rival, speed in zip(rivals, (0.001, -0.001), strict=True):
                    rival.publish(joint_state(stamp, ['x', 'y'], velocity=[speed, 0.0]))
                status = statuses(client.latest(topics.DIAGNOSTICS))['stage_driver: set-points']
                words = 'streams set-points: end all but one of test_client, test_client'
                return words in status.message

            client.wait_for(rivals_shown, PATIENCE, 'the second controller on /diagnostics')
            assert client.set_bool('/stage_driver/enable', False) == 'disabled'
    finally:
        plant.close()


def at_rest(plant):
    """Whether the plant has not moved for 300 ticks."""
    places = [place for place, _ in plant.trace[-300:]]
    far = max(abs(one - last) for one, last in zip(places[0], places[-1], strict=True))
    return len(places) == 300 and far < 2e-6


def stopped_in_a_run(client, plant, moving):
    """Stop a contour run in real time once it is `moving`; the stage stays where it stops."""
    stop = client.node.create_client(Trigger, '/stage_driver/stop')
    run = client.node.create_client(Trigger, '/contour_ctrl/run')
    assert stop.wait_for_service(PATIENCE) and run.wait_for_service(PATIENCE)
    failed = run.call_async(Trigger.Request())
    client.wait_for(moving, PATIENCE, 'the run')
    answer = stop.call_async(Trigger.Request())
    client.wait_for(answer.done, PATIENCE, 'the answer of ~/stop')
    assert answer.result().message == 'stopping'
    client.wait_for(failed.done, PATIENCE, 'the end of the run')
    assert not failed.result().success and 'stopped' in failed.result().message
    client.wait_for(lambda: at_rest(plant), PATIENCE, 'the rest')
    where = list(plant.position)
    time.sleep(1.0)
    # The loop settles by micrometres; a contour or an approach would have gone on by 1 mm.
    assert plant.position == pytest.approx(where, abs=2e-5)


def test_a_contour_is_refused_before_homing_and_ends_with_the_stop_of_its_stream(ros_env):
    plant = SmallPlant(lockstep=False)
    plant.start()
    # Longer than the test waits: a run that is not refused at once is not refused in time.
    patient = {'radius': 0.002, 'feed': 0.001, 'approach_timeout': 2.0 * PATIENCE}
    try:
        with (
            # A busy machine's drive is late.
            node(DRIVER, ros_env, drive_port=plant.port, link_timeout=60.0),
            node('contour_ctrl.node', ros_env, **patient),
            GraphClient('test_client') as client,
        ):
            client.watch(JointState, topics.JOINT_STATES)
            client.wait_for(
                lambda: client.latest(topics.JOINT_STATES) is not None, PATIENCE, 'the stage'
            )
            client.wait_for_service('/contour_ctrl/run', PATIENCE)
            # The two have met, too.
            client.wait_for(
                lambda: client.node.count_subscribers(topics.SETPOINT) > 0, PATIENCE, 'the driver'
            )
            # The second run is refused, or begins and ends before the driver's state has come.
            for words in ('the stage is not homed: call /stage_driver/home first', 'disabled'):
                with pytest.raises(StageError, match=words):
                    client.trigger('/contour_ctrl/run', PATIENCE)
                client.set_bool('/stage_driver/enable', False)
            client.set_bool('/stage_driver/enable', True)
            client.trigger('/stage_driver/home', PATIENCE)
            setpoints = []
            client.watch(JointState, topics.SETPOINT, SETPOINT_QOS, setpoints.append)
            # On the way to the circle, and on it.
            stopped_in_a_run(client, plant, lambda: plant.position[0] > 1e-4)
            stopped_in_a_run(client, plant, lambda: plant.position[1] > 0.5e-3)
            # The stream ends without a move.
            assert len(setpoints[-1].velocity) == 2
    finally:
        plant.close()


def test_zaber_node_keeps_its_port_reports_a_pulled_cable_and_goes_on_after_the_reset(
    ros_env, tmp_path
):
    link = tmp_path / 'zaber'
    file = CONFIG.with_name('stage_driver_zaber.yaml')
    # A pulled cable is a hang-up of the port; a busy machine is late with its answers.
    patient = {'reply_timeout': 5.0, 'link_timeout': 60.0}
    with (
        ZaberPty(chain(1000, 1000), link=link) as server,
        node(DRIVER, ros_env, file, **patient, port=link) as first,
        GraphClient('test_client') as client,
    ):
        client.watch(JointState, topics.JOINT_STATES)
        client.watch(DiagnosticArray, topics.DIAGNOSTICS)
        assert client.trigger('/stage_driver/home', PATIENCE) == 'homed: x, y'
        # In another terminal, with its own folder for temporary files.
        elsewhere = {**ros_env, 'TMPDIR': str(tmp_path)}
        second = start(DRIVER, elsewhere, file, **patient, port=server.port)
        refused = second.communicate()[0]
        assert second.returncode == 2
        assert re.search(
            rf'stage_driver with pid {first.pid} \(since \d\d:\d\d\) holds the port '
            rf'{server.port}: stop it, or give this driver another port',
            refused,
        )
        setpoints = client.node.create_publisher(JointState, topics.SETPOINT, SETPOINT_QOS)
        client.wait_for(lambda: setpoints.get_subscription_count() > 0, PATIENCE, 'the driver')

        def shown(words):
            found = statuses(client.latest(topics.DIAGNOSTICS) or DiagnosticArray())
            status = found.get('stage_driver: state')
            return status is not None and words in status.message

        def connected():
            found = statuses(client.latest(topics.DIAGNOSTICS))['stage_driver: state'].values
            return {value.key: value.value for value in found}['connected'] == 'True'

        def arrived(x):
            latest = client.latest(topics.JOINT_STATES)
            return latest is not None and abs(latest.position[0] - x) < 1e-6

        reset = client.node.create_client(Trigger, '/stage_driver/reset_fault')
        assert reset.wait_for_service(PATIENCE)
        setpoints.publish(joint_state(0, ['x', 'y'], [0.002, 0.001]))
        client.wait_for(lambda: arrived(0.002), PATIENCE, 'the move')
        server.unplug()
        client.wait_for(lambda: shown('fault'), PATIENCE, 'the fault on /diagnostics')
        server.plug()

        client.wait_for(connected, PATIENCE, 'the cable seen again')
        answer = reset.call_async(Trigger.Request())
        client.wait_for(answer.done, PATIENCE, 'the answer of ~/reset_fault')
        assert answer.result().message == 'ready'
        setpoints.publish(joint_state(0, ['x', 'y'], [0.003, 0.001]))
        client.wait_for(lambda: arrived(0.003), PATIENCE, 'the move after the reset')


@pytest.mark.parametrize(
    ('parameters', 'words'),
    [
        ({'backend': 'zaber', 'port': '/dev/null'}, 'cannot open port /dev/null'),
        ({'x.limit_lower': 0.5}, 'limits of x'),
    ],
)
def test_wrong_parameters_are_one_line_and_exit_status_two(ros_env, parameters, words):
    driver = start(DRIVER, ros_env, **parameters)
    said = driver.communicate()[0]
    assert driver.returncode == 2
    assert len(said.strip().splitlines()) == 1
    assert words in said
