"""Compensator and watchdog of a real PSM: ros2 launch dvrk_gravity psm.launch.py model:=…."""

from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution, ThisLaunchFileDir

from launch import LaunchDescription


def generate_launch_description() -> LaunchDescription:
    one_arm = PathJoinSubstitution([ThisLaunchFileDir(), "arm.launch.py"])
    given = {name: LaunchConfiguration(name) for name in ("namespace", "model")}
    return LaunchDescription(
        [
            DeclareLaunchArgument("namespace", default_value="PSM1"),
            DeclareLaunchArgument("model", description="model of this very arm"),
            IncludeLaunchDescription(
                PythonLaunchDescriptionSource(one_arm), launch_arguments=given.items()
            ),
        ]
    )
