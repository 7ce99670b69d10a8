"""A recording through the three nodes.

ros2 launch etd_ros replay.launch.py recording:=/path/to/bag targets_file:=/path/to/boxes.csv
"""

from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution, PythonExpression
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription

ARGUMENTS = {
    "rate": ("1.0", "1 is the recorded pace, 2 twice as fast"),
    "camera": ("event_camera", "namespace of the recorded event topic"),
    "targets_file": ("", "BOXES.csv: targets start at the first row of each name"),
    "targets": ("", "targets as NAME:X,Y,W,H@STAMP_NS, separated by ';'"),
    "auto": ("false", "moving objects become targets auto_1, auto_2, ... by themselves"),
    "method": ("etd-plus", "tracking method"),
}


def generate_launch_description() -> LaunchDescription:
    """The nodes of camera.launch.py, fed by replay, on the recording's clock."""
    nodes = IncludeLaunchDescription(
        PathJoinSubstitution([FindPackageShare("etd_ros"), "launch", "camera.launch.py"]),
        launch_arguments={
            "use_sim_time": "true",
            **{name: LaunchConfiguration(name) for name in ("camera", "targets_file", "targets", "auto", "method")},
        }.items(),
    )
    replay = Node(
        package="etd_ros",
        executable="replay",
        output="screen",
        arguments=[
            LaunchConfiguration("recording"),
            "--rate",
            LaunchConfiguration("rate"),
            "--clock",
            "--wait-for",
            # Without recovery nobody asks for images, so the reconstruction reads no events.
            PythonExpression(["1 if '", LaunchConfiguration("method"), "' == 'etd-nr' else 2"]),
        ],
    )
    declarations = [
        DeclareLaunchArgument(name, default_value=default, description=text)
        for name, (default, text) in ARGUMENTS.items()
    ]
    recording = DeclareLaunchArgument("recording", description="bag, .mcap, .db3, AEDAT4, .raw, or events.txt")
    return LaunchDescription([recording, *declarations, nodes, replay])
