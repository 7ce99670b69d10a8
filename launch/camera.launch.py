"""Accumulator, reconstruction and tracker beside a camera driver.

ros2 launch etd_ros camera.launch.py camera:=event_camera
"""

from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription

ARGUMENTS = {
    "camera": ("event_camera", "name of the camera driver's node: its events are on /<camera>/events"),
    "namespace": ("", "namespace of the three nodes"),
}


def generate_launch_description() -> LaunchDescription:
    """Three processes, linked by topics in one namespace."""
    arguments = (
        DeclareLaunchArgument(name, default_value=default, description=text)
        for name, (default, text) in ARGUMENTS.items()
    )
    nodes = IncludeLaunchDescription(
        PathJoinSubstitution([FindPackageShare("etd_ros"), "launch", "cameras.launch.py"]),
        launch_arguments={
            "cameras": LaunchConfiguration("camera"),
            "namespace": LaunchConfiguration("namespace"),
            "nodes": "accumulator reconstruction tracker",
        }.items(),
    )
    return LaunchDescription([*arguments, nodes])
