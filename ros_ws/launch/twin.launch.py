"""The graph on the embedded twin: ``ros2 launch ros_ws/launch/twin.launch.py clock:=realtime``.

``composed:=true`` runs driver and contour controller in one process.
"""

from pathlib import Path

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PythonExpression
from launch_ros.actions import Node

CONFIG = Path(__file__).resolve().parents[1] / 'config'


def generate_launch_description() -> LaunchDescription:
    """Plant, driver, tracker bridge, recorder, calibrator, controller, diagnosis."""
    clock = LaunchConfiguration('clock')
    simulated = PythonExpression(["'", clock, "' == 'lockstep'"])
    source_clock = PythonExpression(["'ros' if '", clock, "' == 'lockstep' else 'own'"])

    composed = LaunchConfiguration('composed')

    def wanted(executable: str) -> IfCondition:
        asked = LaunchConfiguration(executable, default='true')
        if executable not in ('stage_driver', 'contour_ctrl'):
            return IfCondition(asked)
        return IfCondition(
            PythonExpression(["'", asked, "' == 'true' and '", composed, "' != 'true'"])
        )

    def node(package: str, executable: str, config: str, **parameters: object) -> Node:
        return Node(
            package=package,
            executable=executable,
            name=executable,
            output='screen',
            parameters=[str(CONFIG / config), parameters],
            condition=wanted(executable),
        )

    nominal = str(CONFIG / 'twin_nominal.yaml')
    return LaunchDescription(
        [
            DeclareLaunchArgument('clock', default_value='realtime'),
            DeclareLaunchArgument('composed', default_value='false'),
            DeclareLaunchArgument('reality', default_value=str(CONFIG / 'twin_reality.yaml')),
            node(
                'stage_twin',
                'stage_twin',
                'stage_twin.yaml',
                twin=LaunchConfiguration('reality'),
                clock=clock,
            ),
            node(
                'stage_driver',
                'stage_driver',
                'stage_driver_servo.yaml',
                twin=nominal,
                use_sim_time=simulated,
            ),
            node(
                'tracker_bridge',
                'tracker_bridge',
                'tracker_bridge.yaml',
                source_clock=source_clock,
                use_sim_time=simulated,
            ),
            node(
                'session_bags',
                'session_recorder',
                'session_recorder.yaml',
                twin=nominal,
                use_sim_time=simulated,
            ),
            node('calibrator', 'calibrator', 'calibrator.yaml', use_sim_time=simulated),
            node('contour_ctrl', 'contour_ctrl', 'contour_ctrl.yaml', use_sim_time=simulated),
            # Without a name of its own: it would be that of both nodes.
            Node(
                package='stage_bringup',
                executable='control',
                output='screen',
                parameters=[
                    str(CONFIG / 'stage_driver_servo.yaml'),
                    str(CONFIG / 'contour_ctrl.yaml'),
                    {'use_sim_time': simulated},
                ],
                ros_arguments=['-p', f'stage_driver:twin:={nominal}'],
                condition=IfCondition(composed),
            ),
            node(
                'gap_diagnosis',
                'gap_diagnosis',
                'gap_diagnosis.yaml',
                twin=nominal,
                use_sim_time=simulated,
            ),
        ]
    )
