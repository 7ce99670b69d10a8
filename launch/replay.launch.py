"""A recording through the three nodes, or through the pipeline.

ros2 launch etd_ros replay.launch.py recording:=/path/to/bag targets_file:=/path/to/boxes.csv
"""

from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription, OpaqueFunction
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

from launch import LaunchContext, LaunchDescription

ARGUMENTS = {
    "rate": ("1.0", "1 is the recorded pace, 2 twice as fast"),
    "loop": ("false", "start again at the end"),
    "camera": ("event_camera", "namespace of the recorded event topic"),
    "nodes": ("accumulator reconstruction tracker", "what to start; pipeline is all in one process"),
    "namespace": ("", "namespace of the nodes"),
}
NEVER_RECOVERS = "etd-nr"
"""Without recovery nobody asks for images, so the reconstruction reads no events."""


def play(context: LaunchContext) -> list[Node]:
    """The replay, which starts once every node that reads events is there."""
    values = context.launch_configurations
    readers = {"accumulator", "pipeline"} | ({"reconstruction"} if values["method"] != NEVER_RECOVERS else set())
    waits_for = len(readers & set(values["nodes"].split()))
    return [
        Node(
            package="etd_ros",
            executable="replay",
            output="screen",
            arguments=[
                *(values["recording"], "--rate", values["rate"], "--clock", "--wait-for", str(waits_for)),
                *(["--loop"] if values["loop"] == "true" else []),
            ],
        )
    ]


def generate_launch_description() -> LaunchDescription:
    """The nodes of cameras.launch.py, fed by replay, on the recording's clock."""
    recording = DeclareLaunchArgument("recording", description="bag, .mcap, .db3, AEDAT4, .raw, or events.txt")
    arguments = (
        DeclareLaunchArgument(name, default_value=default, description=text)
        for name, (default, text) in ARGUMENTS.items()
    )
    nodes = IncludeLaunchDescription(
        PathJoinSubstitution([FindPackageShare("etd_ros"), "launch", "cameras.launch.py"]),
        launch_arguments={"cameras": LaunchConfiguration("camera"), "use_sim_time": "true"}.items(),
    )
    return LaunchDescription([recording, *arguments, nodes, OpaqueFunction(function=play)])
