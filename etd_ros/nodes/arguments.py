"""What stands on a node's command line and means nothing to it is said, instead of being passed over."""

from __future__ import annotations

import itertools
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.utilities import remove_ros_args

from etd_ros.errors import EtdError
from etd_ros.nodes.ros_errors import ros_error
from etd_ros.parameters import meant
from etd_ros.settings import described_settings

BEGIN_ROS, END_ROS = "--ros-args", "--"
PARAMETER_FILE = "--params-file"
VALUES_KEY = "ros__parameters"
_WILDCARDS = {"*": r"/\w+", "**": r"(/\w+)*"}


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
    """In one line, where parameter files were given and hold none for this node, which ROS passes over in silence.

    ROS tells only what it has made of all files and `-p` together, so the files are read here, too.
    """
    name = node.get_fully_qualified_name()
    files = [file for option, file in itertools.pairwise(sys.argv) if option == PARAMETER_FILE]
    without = [file for file in files if not holds_parameters_for(name, Path(file))]
    if without:
        node.get_logger().warning(
            f"{', '.join(without)}: no parameters for {name}: they stand under ros__parameters, in a section that has "
            "the node's name, or in /** for all nodes"
        )


def holds_parameters_for(node_name: str, file: Path) -> bool:
    """Whether a parameter file has a section, with something in it, for the node of this full name; also where the file
    cannot be read, of which ROS has more to say."""
    try:
        content = yaml.safe_load(file.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, yaml.YAMLError):
        return True
    return any(re.fullmatch(section, node_name) for section in _sections(content))


def _sections(content: Any, above: str = "") -> Iterator[str]:
    """Patterns of the full names that the sections hold for: a section's name may be spread over several levels, a `*`
    is one word of a name, a `**` any number of them."""
    for key, inner in content.items() if isinstance(content, dict) else ():
        if key == VALUES_KEY:
            if inner:
                yield above
            continue
        words = str(key).strip("/").split("/")
        yield from _sections(inner, above + "".join(_WILDCARDS.get(word, f"/{re.escape(word)}") for word in words))


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
