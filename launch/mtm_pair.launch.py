"""Compensators and watchdogs of two real master arms.

ros2 launch dvrk_gravity mtm_pair.launch.py left_model:=… right_model:=…
"""

from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution, ThisLaunchFileDir

from launch import LaunchDescription


def generate_launch_description() -> LaunchDescription:
    one_arm = PathJoinSubstitution([ThisLaunchFileDir(), "arm.launch.py"])
    entities: list[object] = [
        DeclareLaunchArgument(
            "disable_builtin",
            default_value="false",
            description="true: switch the arms' own compensation off",
        )
    ]
    for side, namespace in (("left", "MTML"), ("right", "MTMR")):
        given = {
            "namespace": LaunchConfiguration(f"{side}_namespace"),
            "model": LaunchConfiguration(f"{side}_model"),
            "disable_builtin": LaunchConfiguration("disable_builtin"),
        }
        entities += [
            DeclareLaunchArgument(f"{side}_namespace", default_value=namespace),
            DeclareLaunchArgument(f"{side}_model", description=f"model of this very {side} arm"),
            IncludeLaunchDescription(
                PythonLaunchDescriptionSource(one_arm), launch_arguments=given.items()
            ),
        ]
    return LaunchDescription(entities)
