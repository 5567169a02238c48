"""Where an arm takes its commands, and what of a JointState they are."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from rclpy.exceptions import InvalidTopicNameException
from rclpy.validate_topic_name import validate_topic_name
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from dvrk_gravity.errors import ConfigError

PARAMETERS = ("output", "output_topic")
EFFORT = ("effort",)


@dataclass(frozen=True)
class CommandTopic:
    """Efforts that the compensator publishes and its watchdog watches, or a stream of positions.

    Attributes:
        name: Its name.
        as_array: A Float64MultiArray, as effort controllers of ros2_control take it, in place of a
            JointState.
        fields: Of a JointState that its messages have.
    """

    name: str
    as_array: bool
    fields: tuple[str, ...] = EFFORT

    @classmethod
    def positions(cls) -> CommandTopic:
        """Return where an arm takes a stream of positions."""
        return cls("servo_jp", False, ("position", "velocity"))

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> CommandTopic:
        """Return what checked values of :data:`PARAMETERS` say.

        Raises:
            ConfigError: What no topic can be called.
        """
        as_array = values["output"] == "array"
        name = values["output_topic"] or ("commands" if as_array else "servo_jf")
        try:
            validate_topic_name(name)
        except InvalidTopicNameException as error:
            raise ConfigError("output_topic", name, "the name of a topic") from error
        return cls(name, as_array)

    @property
    def message_type(self) -> Any:
        """Type of its messages."""
        return Float64MultiArray if self.as_array else JointState

    def effort(self, message: Any) -> Any:
        """Return the efforts in a message, N·m or N."""
        return message.data if self.as_array else message.effort
