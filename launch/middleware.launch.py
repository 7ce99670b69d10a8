"""What the middleware needs, for whatever this launch file is included before.

Large messages go through shared memory. Every process of the chain needs that, a camera's driver among them: include
this file in the driver's launch file, too.
"""

from collections.abc import Mapping

from launch.actions import DeclareLaunchArgument, OpaqueFunction, SetEnvironmentVariable
from launch.substitutions import PathJoinSubstitution
from launch_ros.substitutions import FindPackageShare

from launch import LaunchContext, LaunchDescription

PROFILES_FILE = "FASTRTPS_DEFAULT_PROFILES_FILE"
OWN_TRANSPORTS = (PROFILES_FILE, "FASTDDS_BUILTIN_TRANSPORTS")
SERVER, SUPER_CLIENT = "ROS_DISCOVERY_SERVER", "ROS_SUPER_CLIENT"


def set_environment(context: LaunchContext) -> list[SetEnvironmentVariable]:
    """What the user has chosen himself stays as it is."""
    environment: Mapping[str, str] = context.environment
    settings = []
    if context.launch_configurations["shared_memory"] == "true" and not any(map(environment.get, OWN_TRANSPORTS)):
        profile = PathJoinSubstitution([FindPackageShare("etd_ros"), "config", "fastdds_shm.xml"])
        settings.append(SetEnvironmentVariable(PROFILES_FILE, profile))
    if environment.get(SERVER) and SUPER_CLIENT not in environment:
        # A mere client is told of a topic only once it reads it, but the nodes read events in the type that they see.
        settings.append(SetEnvironmentVariable(SUPER_CLIENT, "TRUE"))
    return settings


def generate_launch_description() -> LaunchDescription:
    """Sets the environment of the processes that are started after it."""
    shared_memory = DeclareLaunchArgument(
        "shared_memory",
        default_value="true",
        choices=["true", "false"],
        description=f"config/fastdds_shm.xml for all nodes, unless the environment sets {' or '.join(OWN_TRANSPORTS)}",
    )
    return LaunchDescription([shared_memory, OpaqueFunction(function=set_environment)])
