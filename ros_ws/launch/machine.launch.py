"""The graph on a real Zaber stage and tracker.

``ros2 launch ros_ws/launch/machine.launch.py port:=/dev/ttyUSB0 tracker:=192.168.0.1``
``nominal:=TWIN.yaml`` names the twin file of your machine.
``composed:=true`` runs driver and contour controller in one process.
"""

from pathlib import Path

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition, UnlessCondition
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

#: What `control` holds in one process.
CONTROL = ('stage_driver', 'contour_ctrl')
CONFIG = Path(__file__).resolve().parents[1] / 'config'


def generate_launch_description() -> LaunchDescription:
    """Driver, tracker bridge, recorder, calibrator, controller, diagnosis."""

    composed = LaunchConfiguration('composed')

    def node(package: str, executable: str, config: str, **parameters: object) -> Node:
        return Node(
            package=package,
            executable=executable,
            name=executable,
            output='screen',
            parameters=[str(CONFIG / config), parameters],
            condition=UnlessCondition(composed) if executable in CONTROL else None,
        )

    nominal = LaunchConfiguration('nominal')
    return LaunchDescription(
        [
            DeclareLaunchArgument('port', default_value='/dev/ttyUSB0'),
            DeclareLaunchArgument('composed', default_value='false'),
            DeclareLaunchArgument('tracker', default_value='192.168.0.1'),
            DeclareLaunchArgument(
                'nominal', default_value=str(CONFIG / 'twin_stepper_nominal.yaml')
            ),
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
            # Without a name of its own: it would be that of both nodes.
            Node(
                package='stage_bringup',
                executable='control',
                output='screen',
                parameters=[
                    str(CONFIG / 'stage_driver_zaber.yaml'),
                    str(CONFIG / 'contour_ctrl_zaber.yaml'),
                ],
                ros_arguments=['-p', ['stage_driver:port:=', LaunchConfiguration('port')]],
                condition=IfCondition(composed),
            ),
            node('gap_diagnosis', 'gap_diagnosis', 'gap_diagnosis.yaml', twin=nominal),
        ]
    )
