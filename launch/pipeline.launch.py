"""Everything in one process.

ros2 launch etd_ros pipeline.launch.py camera:=event_camera targets:='ball:100,80,30,30'
"""

from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription

ARGUMENTS = {
    "camera": ("event_camera", "name of the camera driver's node: its events are on /<camera>/events"),
    "namespace": ("", "namespace of the node"),
}


def generate_launch_description() -> LaunchDescription:
    """One process from events to boxes."""
    arguments = (
        DeclareLaunchArgument(name, default_value=default, description=text)
        for name, (default, text) in ARGUMENTS.items()
    )
    nodes = IncludeLaunchDescription(
        PathJoinSubstitution([FindPackageShare("etd_ros"), "launch", "cameras.launch.py"]),
        launch_arguments={
            "cameras": LaunchConfiguration("camera"),
            "namespace": LaunchConfiguration("namespace"),
            "nodes": "pipeline",
        }.items(),
    )
    return LaunchDescription([*arguments, nodes])
