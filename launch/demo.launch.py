"""Simulated arm, watchdog, compensator and monitor, for those who have ROS 2 Jazzy installed."""

from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription


def generate_launch_description() -> LaunchDescription:
    config = PathJoinSubstitution([FindPackageShare("dvrk_gravity"), "config"])
    model = LaunchConfiguration("model")
    plant = {"plant": LaunchConfiguration("plant")}
    namespace = LaunchConfiguration("namespace")

    def node(executable: str, *parameters: object, **further: object) -> Node:
        return Node(
            package="dvrk_gravity",
            executable=executable,
            namespace=namespace,
            parameters=list(parameters),
            output="screen",
            **further,
        )

    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "namespace",
                default_value="dvrk_gravity_private/MTMR",
                description="of all topics; the default is one that no arm has",
            ),
            DeclareLaunchArgument(
                "model",
                default_value=PathJoinSubstitution([config, "mtmr_28002.yaml"]),
                description="torque model: a parameter file of the compensator",
            ),
            DeclareLaunchArgument(
                "plant",
                default_value="mtmr_28002",
                description="what is simulated: a plant's name, or a plant, model or .urdf file",
            ),
            DeclareLaunchArgument(
                "monitor",
                default_value="false",
                description="true: publish what is expected, what pushes, what changed",
            ),
            node("simulator", plant),
            node("watchdog", model),
            # The simulated arm's clock is behind by all the time that a slow machine has left out.
            node("compensator", model, {"disable_builtin": True, "max_stamp_age": 0.0}),
            node("monitor", model, condition=IfCondition(LaunchConfiguration("monitor"))),
        ]
    )
