"""What ROS refuses, as errors that a user can act on."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager

import rclpy

from etd_ros.errors import EtdError


class RosError(EtdError):
    """ROS refuses to start."""


@contextmanager
def ros_refusals() -> Iterator[None]:
    """What ROS refuses while it starts, or a node's participant, in one line.

    Raises:
        RosError: an argument that ROS does not understand, such as a parameter file that is missing; DDS security
            that is asked for and cannot be had; a participant that cannot be made.
    """
    was_running = rclpy.ok()
    try:
        yield
    # rclpy's own errors for this have no public name; all of them derive from RuntimeError.
    except RuntimeError as err:
        if was_running and not rclpy.ok():
            raise  # a signal came first
        raise ros_error(err) from err


def ros_reason(err: RuntimeError) -> str:
    """What rclpy says, without the places in its sources."""
    return str(err).partition(", at /")[0]


def ros_error(err: RuntimeError) -> RosError:
    """What rclpy says, and what to do."""
    reason = ros_reason(err)
    if os.environ.get("ROS_SECURITY_ENABLE") == "true":
        return RosError(
            f"ROS does not start with ROS_SECURITY_ENABLE=true ({reason}): it needs a middleware built with security, "
            "ROS_SECURITY_KEYSTORE, and an enclave in it for `--ros-args --enclave /etd_ros/NODE` (docs/security.md)"
        )
    return RosError(f"ROS does not start: {reason}: mend what stands after --ros-args")
