"""On the machine that tracks: frames come from camera_host.launch.py on another.

ros2 launch etd_ros compute_host.launch.py cameras:='front rear' targets_file:='/robot/{camera}.csv'

docs/machines.md says which topics cross the network and how much they bring.
"""

from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution, PythonExpression
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription

NODES = {"camera": "tracker", "compute": "tracker reconstruction"}


def generate_launch_description() -> LaunchDescription:
    """The tracker of each camera, and its reconstruction where that is to be here."""
    reconstruction = DeclareLaunchArgument(
        "reconstruction",
        default_value="compute",
        choices=list(NODES),
        description="host of the reconstruction, the same for both: camera sends images, compute has events sent to it",
    )
    nodes = IncludeLaunchDescription(
        PathJoinSubstitution([FindPackageShare("etd_ros"), "launch", "cameras.launch.py"]),
        launch_arguments={
            "nodes": PythonExpression([f"{NODES}['", LaunchConfiguration("reconstruction"), "']"])
        }.items(),
    )
    return LaunchDescription([reconstruction, nodes])
