"""Large messages through shared memory, for whatever this launch file is included before.

Every process of the chain needs it, a camera's driver among them: include this file in the driver's launch file, too.
"""

from launch.actions import DeclareLaunchArgument, OpaqueFunction, SetEnvironmentVariable
from launch.substitutions import PathJoinSubstitution
from launch_ros.substitutions import FindPackageShare

from launch import LaunchContext, LaunchDescription

PROFILES_FILE = "FASTRTPS_DEFAULT_PROFILES_FILE"
OWN_CHOICES = (PROFILES_FILE, "FASTDDS_BUILTIN_TRANSPORTS")


def choose_profile(context: LaunchContext) -> list[SetEnvironmentVariable]:
    """What the user has chosen himself stays as it is."""
    is_wanted = context.launch_configurations["shared_memory"] == "true"
    if not is_wanted or any(name in context.environment for name in OWN_CHOICES):
        return []
    profile = PathJoinSubstitution([FindPackageShare("etd_ros"), "config", "fastdds_shm.xml"])
    return [SetEnvironmentVariable(PROFILES_FILE, profile)]


def generate_launch_description() -> LaunchDescription:
    """Sets the environment of the processes that are started after it."""
    shared_memory = DeclareLaunchArgument(
        "shared_memory",
        default_value="true",
        choices=["true", "false"],
        description=f"config/fastdds_shm.xml for all nodes, unless the environment sets {' or '.join(OWN_CHOICES)}",
    )
    return LaunchDescription([shared_memory, OpaqueFunction(function=choose_profile)])
