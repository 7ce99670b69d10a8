"""The nodes of one camera or of many, each camera's in a namespace of its own.

ros2 launch etd_ros cameras.launch.py cameras:='front rear' targets_file:='/robot/{camera}.csv'
"""

from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription, OpaqueFunction
from launch.substitutions import PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

from launch import LaunchContext, LaunchDescription

NODES = ("accumulator", "reconstruction", "tracker", "pipeline")
READ_EVENTS = ("accumulator", "reconstruction", "pipeline")
TRACK = ("tracker", "pipeline")
CONVERSIONS = {"etd-plus": "atsltd_fine", "etd-ftw": "fixed_window"}
OTHER_CONVERSION = "atsltd"
ONE_IMAGE_IN_A_WHILE = "etd-plus"
"""The other methods look at the image of every frame."""
CAMERA = "{camera}"
"""Stands for the camera's name in other arguments."""

ARGUMENTS = {
    "cameras": ("event_camera", "names of the cameras, separated by blanks"),
    "nodes": ("pipeline", f"what to start for each camera, separated by blanks: {', '.join(NODES)}"),
    "namespace": (CAMERA, f"namespace of a camera's nodes; {CAMERA} stands for its name here and below"),
    "events": (f"/{CAMERA}/events", "topic of a camera's events, as its driver names it"),
    "params_file": (
        PathJoinSubstitution([FindPackageShare("etd_ros"), "config", "etd_ros.yaml"]),
        "parameter file; arguments that are empty leave the parameters as they are there",
    ),
    "method": ("", "tracking method; the other nodes make the frames and images that it needs"),
    "targets_file": ("", "BOXES.csv: targets start at the first row of each name"),
    "targets": ("", "targets as NAME:X,Y,W,H or NAME:X,Y,W,H@STAMP_NS, separated by ';'"),
    "auto": ("", "true: moving objects become targets auto_1, auto_2, ... by themselves"),
    "use_sim_time": ("false", "follow /clock"),
    "log_level": ("info", "debug, info, warn or error; NODE:=LEVEL for one logger"),
    "respawn": ("false", "start a node again that has ended"),
}
TRUTH_VALUES = {"auto": ["", "true", "false"], "use_sim_time": ["true", "false"], "respawn": ["true", "false"]}


def start_nodes(context: LaunchContext) -> list[Node]:
    """The nodes of all cameras.

    Raises:
        ValueError: a camera is named twice, or a node is not one of NODES.
    """
    values = {name: context.launch_configurations[name] for name in ARGUMENTS}
    cameras, names = values["cameras"].split(), values["nodes"].split()
    if len(set(cameras)) < len(cameras):
        msg = f"cameras:='{values['cameras']}' names one twice: their topics would mix"
        raise ValueError(msg)
    if not names or not set(names) <= set(NODES):
        msg = f"nodes:='{values['nodes']}' must be some of {', '.join(NODES)}"
        raise ValueError(msg)
    return [
        _node(name, {key: value.replace(CAMERA, camera) for key, value in values.items()})
        for camera in cameras
        for name in names
    ]


def _node(name: str, values: dict[str, str]) -> Node:
    return Node(
        package="etd_ros",
        executable=name,
        name=name,
        namespace=values["namespace"],
        output="screen",
        parameters=[values["params_file"], _parameters(name, values)],
        remappings=[("~/events", values["events"])] if name in READ_EVENTS else [],
        ros_arguments=["--log-level", values["log_level"]],
        respawn=values["respawn"] == "true",
        respawn_delay=1.0,
    )


def _parameters(name: str, values: dict[str, str]) -> dict[str, object]:
    """Parameters by arguments; texts are typed, because launch would read `1` as a number and `a: b` as YAML."""
    parameters: dict[str, object] = {"use_sim_time": values["use_sim_time"] == "true"}
    if name == "accumulator" and values["method"]:
        conversion = CONVERSIONS.get(values["method"], OTHER_CONVERSION)
        parameters["conversion"] = ParameterValue(conversion, value_type=str)
    if name == "reconstruction" and values["method"] not in ("", ONE_IMAGE_IN_A_WHILE):
        parameters["image_interval_s"] = 0.0
    if name in TRACK:
        texts = {key: values[key] for key in ("method", "targets_file", "targets") if values[key]}
        parameters |= {key: ParameterValue(text, value_type=str) for key, text in texts.items()}
        if values["auto"]:
            parameters["auto"] = values["auto"] == "true"
    return parameters


def generate_launch_description() -> LaunchDescription:
    """What the other launch files include, with some of the arguments given."""
    arguments = (
        DeclareLaunchArgument(name, default_value=default, description=text, choices=TRUTH_VALUES.get(name))
        for name, (default, text) in ARGUMENTS.items()
    )
    middleware = IncludeLaunchDescription(
        PathJoinSubstitution([FindPackageShare("etd_ros"), "launch", "middleware.launch.py"])
    )
    return LaunchDescription([*arguments, middleware, OpaqueFunction(function=start_nodes)])
