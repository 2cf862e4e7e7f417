"""The graph on a real Zaber stage and tracker.

``ros2 launch ros_ws/launch/machine.launch.py port:=/dev/ttyUSB0 tracker:=192.168.0.1``
"""

from pathlib import Path

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

CONFIG = Path(__file__).resolve().parents[1] / 'config'


def generate_launch_description() -> LaunchDescription:
    """Driver, tracker bridge, recorder, calibrator, controller, diagnosis."""

    def node(package: str, executable: str, config: str, **parameters: object) -> Node:
        return Node(
            package=package,
            executable=executable,
            name=executable,
            output='screen',
            parameters=[str(CONFIG / config), parameters],
        )

    nominal = str(CONFIG / 'twin_stepper_nominal.yaml')
    return LaunchDescription(
        [
            DeclareLaunchArgument('port', default_value='/dev/ttyUSB0'),
            DeclareLaunchArgument('tracker', default_value='192.168.0.1'),
            node(
                'stage_driver',
                'stage_driver',
                'stage_driver_zaber.yaml',
                port=LaunchConfiguration('port'),
            ),
            node(
                'tracker_bridge',
                'tracker_bridge',
                'tracker_bridge.yaml',
                host=LaunchConfiguration('tracker'),
                port=700,
            ),
            node('session_bags', 'session_recorder', 'session_recorder.yaml', twin=nominal),
            node('calibrator', 'calibrator', 'calibrator.yaml'),
            node('contour_ctrl', 'contour_ctrl', 'contour_ctrl_zaber.yaml'),
            node('gap_diagnosis', 'gap_diagnosis', 'gap_diagnosis.yaml', twin=nominal),
        ]
    )
