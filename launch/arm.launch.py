"""Compensator and watchdog of one real arm.

ros2 launch dvrk_gravity arm.launch.py namespace:=… model:=…

Ctrl-C ends both in order: the compensator holds the arm and waits until that is acknowledged.
"""

from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from launch import LaunchDescription


def generate_launch_description() -> LaunchDescription:
    model = LaunchConfiguration("model")

    def node(executable: str, *parameters: object) -> Node:
        return Node(
            package="dvrk_gravity",
            executable=executable,
            namespace=LaunchConfiguration("namespace"),
            parameters=[model, *parameters],
            output="screen",
        )

    return LaunchDescription(
        [
            DeclareLaunchArgument("namespace", description="of the arm's topics, as MTMR"),
            DeclareLaunchArgument(
                "model", description="model of this very arm: the file that `identify` has written"
            ),
            DeclareLaunchArgument(
                "disable_builtin",
                default_value="false",
                description="true: switch the arm's own compensation off",
            ),
            # Of the same file: the compensator believes no watchdog of another topic.
            node("watchdog"),
            node("compensator", {"disable_builtin": LaunchConfiguration("disable_builtin")}),
        ]
    )
