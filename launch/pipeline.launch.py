"""Everything in one process.

ros2 launch etd_ros pipeline.launch.py camera:=event_camera targets:='ball:100,80,30,30'
"""

from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription

ARGUMENTS = {
    "camera": ("event_camera", "name of the camera driver's node: its events are on /<camera>/events"),
    "namespace": ("", "namespace of the node, for several cameras"),
    "params_file": (PathJoinSubstitution([FindPackageShare("etd_ros"), "config", "etd_ros.yaml"]), "parameter file"),
    "method": ("etd-plus", "tracking method"),
    "targets_file": ("", "BOXES.csv: targets start at the first row of each name"),
    "targets": ("", "targets as NAME:X,Y,W,H, separated by ';'"),
    "auto": ("false", "moving objects become targets auto_1, auto_2, ... by themselves"),
    "use_sim_time": ("false", "follow /clock"),
}


def generate_launch_description() -> LaunchDescription:
    """One process from events to boxes."""
    parameters = {
        **{name: ParameterValue(LaunchConfiguration(name), value_type=bool) for name in ("use_sim_time", "auto")},
        **{
            name: ParameterValue(LaunchConfiguration(name), value_type=str)
            for name in ("method", "targets_file", "targets")
        },
    }
    pipeline = Node(
        package="etd_ros",
        executable="pipeline",
        name="pipeline",
        namespace=LaunchConfiguration("namespace"),
        output="screen",
        parameters=[LaunchConfiguration("params_file"), parameters],
        remappings=[("~/events", ["/", LaunchConfiguration("camera"), "/events"])],
    )
    declarations = (
        DeclareLaunchArgument(name, default_value=default, description=text)
        for name, (default, text) in ARGUMENTS.items()
    )
    return LaunchDescription([*declarations, pipeline])
