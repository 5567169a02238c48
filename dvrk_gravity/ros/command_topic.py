"""Where an arm takes its efforts: the console's ``servo_jf``, or an array for ros2_control."""

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


@dataclass(frozen=True)
class CommandTopic:
    """What the compensator publishes, the watchdog watches and the simulator obeys.

    Attributes:
        name: Its name.
        as_array: A Float64MultiArray, as effort controllers of ros2_control take it, in place of a
            JointState.
    """

    name: str
    as_array: bool

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
