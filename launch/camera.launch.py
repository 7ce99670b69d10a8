"""Accumulator, reconstruction and tracker beside a camera driver.

ros2 launch etd_ros camera.launch.py camera:=event_camera
"""

from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution, PythonExpression
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription

ARGUMENTS = {
    "camera": ("event_camera", "name of the camera driver's node: its events are on /<camera>/events"),
    "namespace": ("", "namespace of the three nodes, for several cameras"),
    "params_file": (PathJoinSubstitution([FindPackageShare("etd_ros"), "config", "etd_ros.yaml"]), "parameter file"),
    "method": ("etd-plus", "tracking method"),
    "targets_file": ("", "BOXES.csv: targets start at the first row of each name"),
    "targets": ("", "targets as NAME:X,Y,W,H, separated by ';'"),
    "auto": ("false", "moving objects become targets auto_1, auto_2, ... by themselves"),
    "use_sim_time": ("false", "follow /clock"),
}


def generate_launch_description() -> LaunchDescription:
    """Three processes, linked by topics in one namespace."""
    events = ("~/events", ["/", LaunchConfiguration("camera"), "/events"])
    use_sim_time = ParameterValue(LaunchConfiguration("use_sim_time"), value_type=bool)
    common = [LaunchConfiguration("params_file"), {"use_sim_time": use_sim_time}]
    tracking = {
        "auto": ParameterValue(LaunchConfiguration("auto"), value_type=bool),
        **{
            name: ParameterValue(LaunchConfiguration(name), value_type=str)
            for name in ("method", "targets_file", "targets")
        },
    }
    conversion = PythonExpression(
        ["{'etd-plus': 'atsltd_fine', 'etd-ftw': 'fixed_window'}.get('", LaunchConfiguration("method"), "', 'atsltd')"]
    )
    converting = {"conversion": ParameterValue(conversion, value_type=str)}
    namespace = LaunchConfiguration("namespace")

    def node(name: str, **options: object) -> Node:
        return Node(package="etd_ros", executable=name, name=name, namespace=namespace, output="screen", **options)

    return LaunchDescription(
        [
            *(
                DeclareLaunchArgument(name, default_value=default, description=text)
                for name, (default, text) in ARGUMENTS.items()
            ),
            node("accumulator", parameters=[*common, converting], remappings=[events]),
            node("reconstruction", parameters=common, remappings=[events]),
            node("tracker", parameters=[*common, tracking]),
        ]
    )
