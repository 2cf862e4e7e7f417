"""The node as a process: it learns from what it hears and corrects the command path."""

import json
import signal
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PointStamped
from sensor_msgs.msg import JointState, Temperature
from std_msgs.msg import String

from session_bags.writer import write_session
from stage_core import topics
from stage_core.errors import StageError
from stage_core.ros.client_node import GraphClient
from stage_core.ros.node import (
    LATCHED_QOS,
    SETPOINT_QOS,
    STATE_QOS,
    joint_state,
    set_stamp,
    stamp_of,
)

from ..node_process import node
from ..patience import PATIENCE


@pytest.fixture
def calibrator(ros_env, tmp_path):
    given = {'model_folder': tmp_path / 'models', 'buffer_size': 200_000}
    with node('calibrator.node', ros_env, **given) as process:
        yield process


def test_node_learns_live_and_corrects_targets(calibrator, grid_session, planted_map):
    session = grid_session(40, rest=0.12)
    reference = session.series[topics.REFERENCE]
    points = session.series[topics.TRACKER_POINT]
    with GraphClient() as client:
        client.watch(String, topics.MODEL, LATCHED_QOS)
        client.watch(JointState, topics.SETPOINT, SETPOINT_QOS)
        make = client.node.create_publisher
        targets = make(JointState, topics.TARGET, SETPOINT_QOS)
        states = make(JointState, topics.REFERENCE, STATE_QOS)
        measured = make(PointStamped, topics.TRACKER_POINT, STATE_QOS)
        client.wait_for(lambda: client.latest(topics.MODEL) is not None, PATIENCE, 'a model')
        for publisher in (targets, states, measured):
            client.wait_for(lambda p=publisher: p.get_subscription_count() > 0, PATIENCE, 'reader')
        client.wait_for(
            lambda: client.node.count_publishers(topics.SETPOINT) > 0, PATIENCE, 'discovery'
        )

        def corrected(target, stamp):
            targets.publish(joint_state(stamp, ('x', 'y'), position=target))
            client.wait_for(
                lambda: (
                    (m := client.latest(topics.SETPOINT)) is not None
                    and m.header.stamp.sec == stamp // 10**9
                ),
                PATIENCE,
                'a set-point',
            )
            return np.array(client.latest(topics.SETPOINT).position)

        np.testing.assert_array_equal(corrected((0.01, 0.02), 5 * 10**9), (0.01, 0.02))
        with pytest.raises(StageError, match='live buffer holds no pair'):
            client.trigger('/calibrator/retrain', PATIENCE)
        with pytest.raises(StageError, match='no model to activate'):
            client.set_bool('/calibrator/activate', True)

        rows = reference.columns('position', ('x', 'y'))
        for i, stamp in enumerate(reference.stamps):
            states.publish(joint_state(int(stamp), ('x', 'y'), position=rows[i].tolist()))
            if i % 5 == 0:
                message = PointStamped()
                set_stamp(message.header, int(points.stamps[i // 5]))
                for axis in 'xyz':
                    setattr(message.point, axis, float(points.values[axis][i // 5]))
                measured.publish(message)
            if i % 200 == 0:
                time.sleep(0.01)
        time.sleep(0.5)
        message = client.trigger('/calibrator/retrain', PATIENCE)
        assert 'held-out RMS' in message and 'before' in message and 'after' in message
        assert 'heard live (the parameter bag is empty)' in message and 'tracker points' in message
        client.set_bool('/calibrator/activate', True)
        client.wait_for(
            lambda: json.loads(client.latest(topics.MODEL).data)['active'], PATIENCE, 'activation'
        )
        content = json.loads(client.latest(topics.MODEL).data)
        assert content['method'] == 'structured' and content['version'] == 1
        assert content['metrics']['after']['rms'] < 0.5 * content['metrics']['before']['rms']

        # Where the stage is counts, not where the last target was.
        states.publish(joint_state(int(reference.stamps[-1]), ('x', 'y'), position=(0.02, 0.02)))
        time.sleep(0.5)
        goal = np.array([0.031, 0.027])
        command = corrected(goal.tolist(), 7 * 10**9)
        reached = planted_map(command[None], np.ones((1, 2)))[0]
        before = planted_map(goal[None], np.ones((1, 2)))[0] - goal
        assert np.abs(reached - goal).max() < 0.3 * np.abs(before).max()

        # A training that fails leaves the model in use, and says why.
        client.set_parameters('/calibrator', bag='/nonexistent/bag')
        with pytest.raises(StageError, match='there is no bag /nonexistent/bag'):
            client.trigger('/calibrator/retrain', PATIENCE)
        np.testing.assert_array_equal(corrected(goal.tolist(), 8 * 10**9), command)
    calibrator.send_signal(signal.SIGTERM)
    assert calibrator.wait() == 0


@pytest.fixture
def contour(ros_env):
    """The contour controller in real time, with a circle that begins at (35, 0) mm."""
    with node('contour_ctrl.node', ros_env, radius=0.035) as process:
        yield process


def contour_start(client):
    """Start point (2,) [m] that a contour asked for now moves to; the run is aborted there."""

    def moved():
        message = client.latest(topics.SETPOINT)
        return message is not None and stamp_of(message.header) >= asked

    with ThreadPoolExecutor(1) as pool:
        asked = time.time_ns()
        run = pool.submit(client.trigger, '/contour_ctrl/run', 60.0)
        client.wait_for(lambda: run.done() or moved(), PATIENCE, 'a move to the start')
        assert moved(), run.result()
        move = client.latest(topics.SETPOINT)
        client.trigger('/contour_ctrl/abort', PATIENCE)
        with pytest.raises(StageError, match='aborted by request'):
            run.result()
    return np.array(move.position)


def test_thermal_model_from_a_bag_follows_the_sensors_and_refuses_silent_ones(
    calibrator, contour, tmp_path, warming_session, warm_stage
):
    bag = write_session(tmp_path / 'warming', warming_session)
    states = []

    def keep(message):
        states.extend(s for s in message.status if s.name == 'calibrator: model')

    with GraphClient() as client:
        client.watch(DiagnosticArray, topics.DIAGNOSTICS, callback=keep)
        client.watch(JointState, topics.SETPOINT, SETPOINT_QOS)
        # A contour begins once the stage listens: the node that publishes the joint states.
        client.node.create_publisher(JointState, topics.JOINT_STATES, STATE_QOS)
        targets = client.node.create_publisher(JointState, topics.TARGET, SETPOINT_QOS)
        sensors = client.node.create_publisher(Temperature, topics.TEMPERATURE, STATE_QOS)
        client.wait_for_service('/calibrator/retrain', PATIENCE)
        for publisher in (targets, sensors):
            client.wait_for(lambda p=publisher: p.get_subscription_count() > 0, PATIENCE, 'reader')
        client.wait_for(
            lambda: client.node.count_publishers(topics.SETPOINT) > 0, PATIENCE, 'discovery'
        )
        stamp = 0

        def told(level, words):
            """Wait for a status that was sent from now on."""
            states.clear()
            client.wait_for(
                lambda: any(s.level == level and words in s.message for s in states),
                PATIENCE,
                f'a status with {words}',
            )

        def warm(*degrees):
            for sensor, value in zip(('screw_x', 'screw_y'), degrees, strict=True):
                message = Temperature(temperature=value)
                set_stamp(message.header, 2 * 10**18 + stamp)
                message.header.frame_id = sensor
                sensors.publish(message)

        def corrected(goal, degrees):
            """Set-point for a goal, asked until the node has heard the temperatures."""
            nonlocal stamp

            def answered():
                nonlocal stamp
                stamp += 10**9
                warm(*degrees)
                targets.publish(joint_state(stamp, ('x', 'y'), position=goal.tolist()))
                try:
                    client.wait_for(
                        lambda: (
                            (m := client.latest(topics.SETPOINT)) is not None
                            and m.header.stamp.sec == stamp // 10**9
                        ),
                        2.0,
                        'a set-point',
                    )
                except StageError:
                    return False
                command = np.array(client.latest(topics.SETPOINT).position)
                return np.abs(warm_stage(command, degrees) - goal).max() < 3e-7

            client.wait_for(answered, PATIENCE, f'a correction at {degrees} degC')

        client.set_parameters('/calibrator', bag=str(bag), method='thermal')
        message = client.trigger('/calibrator/retrain', PATIENCE)
        assert message.startswith('thermal: held-out RMS')
        content = json.loads((tmp_path / 'models' / 'model_0001.json').read_text())['content']
        assert content['sensors'] == ['screw_x', 'screw_y']
        assert content['model']['options']['derivatives'] is True
        assert content['metrics']['after']['rms'] < 3e-7 < content['metrics']['before']['rms']

        # Never heard is silent: the means of the training are not the temperature now.
        assert 'screw_x, screw_y is silent' in client.set_bool('/calibrator/activate', True)
        told(b'\x02', 'screw_x, screw_y is silent')

        goal = np.array([0.035, -0.03])
        for degrees in ((23.5, 20.5), (20.5, 22.5)):
            assert np.abs(warm_stage(goal, degrees) - goal).max() > 8e-7
            corrected(goal, degrees)
        told(b'\x00', 'thermal')

        # A contour is planned for what the sensors say when it is asked for.
        client.wait_for_service('/contour_ctrl/run', PATIENCE)
        client.wait_for(
            lambda: client.node.count_publishers(topics.SETPOINT) == 2, PATIENCE, 'discovery'
        )
        for degrees in ((23.5, 20.5), (21.5, 22.5)):
            start = np.array([0.035, 0.0])
            assert np.abs(warm_stage(start, degrees) - start).max() > 8e-7

            def planned(degrees=degrees, start=start):
                warm(*degrees)
                move = contour_start(client)
                return np.abs(warm_stage(move, degrees) - start).max() < 3e-7

            client.wait_for(planned, PATIENCE, f'a contour planned at {degrees} degC')

        before = client.latest(topics.SETPOINT).header.stamp.sec
        client.set_parameters('/calibrator', temperature_timeout=1.0)
        told(b'\x02', 'screw_x, screw_y is silent')
        stamp += 10**9
        targets.publish(joint_state(stamp, ('x', 'y'), position=goal.tolist()))
        client.wait_for(
            lambda: any(
                v.key == 'refused targets' and int(v.value) > 0 for s in states for v in s.values
            ),
            PATIENCE,
            'a refused target',
        )
        assert client.latest(topics.SETPOINT).header.stamp.sec == before

        client.set_parameters('/calibrator', temperature_timeout=600.0)
        corrected(goal, (21.0, 21.0))
        told(b'\x00', 'thermal')
