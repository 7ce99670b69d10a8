"""What stands on a node's command line and means nothing to it is said, instead of being passed over."""

from __future__ import annotations

import itertools
import sys

from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.utilities import remove_ros_args

from etd_ros.errors import EtdError
from etd_ros.nodes.ros_errors import ros_error
from etd_ros.parameters import meant
from etd_ros.settings import described_settings

BEGIN_ROS, END_ROS = "--ros-args", "--"
PARAMETER_FILE = "--params-file"


class ArgumentError(EtdError):
    """A word on the command line that means nothing."""


def own_arguments(arguments: list[str]) -> list[str]:
    """The program's arguments without its name and without those that are ROS's: what stands between --ros-args and --.

    Without --ros-args ROS would take `auto:=true` for a remapping of an earlier day, and what was meant as a parameter
    would be passed over: that is the program's own, too.

    Raises:
        RosError: ROS's ones are wrong.
    """
    own: list[str] = []
    of_ros: list[str] = []
    is_ros = False
    for word in arguments[1:]:
        is_ros = is_ros or word == BEGIN_ROS
        (of_ros if is_ros else own).append(word)
        is_ros = is_ros and word != END_ROS
    try:
        remove_ros_args([*arguments[:1], *of_ros])
    except RuntimeError as err:
        raise ros_error(err) from err
    return own


def refuse_stray_words(arguments: list[str]) -> None:
    """For nodes that take nothing but what is ROS's.

    Args:
        arguments: the program's, its name first.

    Raises:
        ArgumentError: something stands outside of --ros-args.
        RosError: ROS's arguments are wrong.
    """
    stray = own_arguments(arguments)
    if stray:
        msg = f"{' '.join(stray)}: unknown: parameters and remappings are written as --ros-args -p NAME:=VALUE -r A:=B"
        raise ArgumentError(msg)


def given_parameters(node: Node) -> dict[str, Parameter]:
    """The parameters on the command line and in its files that are a node's, by name, whether it has declared them or
    not."""
    with node.handle:
        return dict(node.handle.get_parameters(Parameter))


def warn_of_files_without_parameters(node: Node) -> None:
    """In one line, where parameter files were given and hold none for this node, which ROS passes over in silence."""
    files = [file for option, file in itertools.pairwise(sys.argv) if option == PARAMETER_FILE]
    if files and not given_parameters(node):
        node.get_logger().warning(
            f"{', '.join(files)}: no parameters for {node.get_fully_qualified_name()}: they stand under "
            "ros__parameters, in a section that has the node's name, or in /** for all nodes"
        )


def warn_of_unknown_parameters(node: Node) -> None:
    """In one line, after the node has declared its own.

    What was given for all nodes cannot be told from what was given for this one, so it is never refused. A file for
    all nodes has the parameters of every stage of the method, and a node only those of its own stages.
    """
    given = given_parameters(node)
    of_stages = {name for name, *_ in described_settings()}
    unknown = sorted(name for name in given if not node.has_parameter(name) and name not in of_stages)
    if unknown:
        known = list(node.get_parameters_by_prefix(""))
        words = ", ".join(f"{name}{meant(name, known)}" for name in unknown)
        node.get_logger().warning(
            f"no parameters of this node, left out: {words} (harmless where other nodes are meant; "
            f"`ros2 param list {node.get_fully_qualified_name()}` has those that there are)"
        )
