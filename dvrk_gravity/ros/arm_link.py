"""The one way to an arm, for every node that commands one.

It knows who measures the arm, who else commands it, and how a hold is brought home; nothing else
in the package publishes a motion command.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from std_msgs.msg import Float64MultiArray, MultiArrayDimension, MultiArrayLayout

from dvrk_gravity.arms import Arm
from dvrk_gravity.compensate import Sample, SampleReader
from dvrk_gravity.ros import operating_state
from dvrk_gravity.ros.command_topic import CommandTopic
from dvrk_gravity.ros.hold import Hold
from dvrk_gravity.ros.others import Others
from dvrk_gravity.ros.presence import MEASURED, Presence
from dvrk_gravity.ros.rivals import Rivals
from dvrk_gravity.ros.wire import CommandWriter, JointStateReader, Stamp

__all__ = ["MEASURED", "ArmLink"]

# DDS sends what was lost again, seconds later: an old command must not come after a hold.
_COMMANDS = QoSProfile(depth=10, lifespan=Duration(seconds=0.1))


class ArmLink:
    """Commands one arm, and knows what there is against it.

    Attributes:
        hold: Holds the arm, and sees to it that the hold arrives.
        others: Those who command the arm on other topics.
        rivals: Those who command it on ours.
        further: Joints that ``measured_js`` holds beside the arm's.
    """

    def __init__(
        self,
        node: Node,
        arm: Arm,
        topic: CommandTopic,
        margin: NDArray[np.float64] | float = np.inf,
        on_other: Callable[[], None] = lambda: None,
        on_rival: Callable[[], None] = lambda: None,
        on_state: Callable[[str], None] = lambda reason: None,
    ) -> None:
        """Connect the topics of the node's namespace.

        Args:
            node: The node.
            arm: The arm.
            topic: Where it takes commands.
            margin: (n,) positions further outside the arm's limits are refused, rad or m.
            on_other: Called for a command of somebody else on another topic.
            on_rival: Called for one on ours.
            on_state: Called with what the arm's operating state says against commanding it.
        """
        self._as_array = topic.as_array
        self._command = node.create_publisher(topic.message_type, topic.name, _COMMANDS)
        self._presence = Presence(node, any_subscriber=topic.as_array)
        self.hold = Hold(node, self._presence.listens)
        # Controllers of ros2_control subscribe with the middleware's defaults, which is DDS's best
        # effort: whom they obey is not heard otherwise. An arm's console is reliable.
        reliability = (
            ReliabilityPolicy.BEST_EFFORT if topic.as_array else ReliabilityPolicy.RELIABLE
        )
        self.rivals = Rivals(node, self._command, on_rival, reliability)
        self.others = Others(node, self.topic, self.hold.echo, on_other)
        operating_state.subscribe(node, on_state)
        self._unpack = JointStateReader().read
        self._read = SampleReader(
            arm.joint_names, arm.lower - margin, arm.upper + margin, arm.units, arm.drive_gains,
            arm.name, arm.held,
        ).read  # fmt: skip
        self._joints, self._fields = arm.joint_names, topic.fields
        self.further: tuple[str, ...] = ()
        self._write_in(arm.joint_names)

    @property
    def topic(self) -> str:
        """Full name of the topic of our commands."""
        return self._command.topic_name

    def is_there(self) -> bool:
        """Tell whether somebody publishes ``measured_js``."""
        return self._presence.is_there()

    def is_connected(self) -> bool:
        """Tell whether the arm measures, takes our commands, and hears a hold."""
        return (
            self.is_there()
            and self._command.get_subscription_count() > 0
            and self._presence.listens()
        )

    def two_measure(self, info: Mapping[str, Any]) -> str:
        """Take what the middleware says of a message of ``measured_js``.

        Returns:
            Who measures if there are several, for the messages may be of two arms; else ``""``.
        """
        mixed = self._presence.count(info["publication_sequence_number"])
        return self._presence.two_measure() if mixed else ""

    def read(self, data: bytes) -> tuple[Sample, Stamp]:
        """Return what the bytes of a message of ``measured_js`` say of the arm, and its stamp.

        Raises:
            DroppedSampleError: It cannot be answered with a command.
        """
        fields = self._unpack(data)
        sample = self._read(
            fields.stamp_ns, fields.names, fields.position, fields.velocity, fields.effort
        )
        if fields.names is not self._measured:
            self._write_in(fields.names)
        return sample, fields.stamp

    def _write_in(self, names: tuple[str, ...]) -> None:
        """Write commands in the order in which the arm measures its joints.

        A console takes them by index and ignores their names; what it measures is in its order.
        """
        self._measured = names
        ours = tuple(name for name in names if name in self._joints)
        self.further = tuple(name for name in names if name not in self._joints)
        self._order = None if ours == self._joints else [self._joints.index(name) for name in ours]
        self._writer = CommandWriter(ours, self.rivals.mark, self._fields)

    def publish(self, stamp: Stamp, *values: Any) -> None:
        """Command the arm: (n,) numbers for each of the fields that its topic has."""
        if self._as_array:
            (effort,) = values
            label = MultiArrayDimension(label=self.rivals.mark, size=len(effort), stride=1)
            layout = MultiArrayLayout(dim=[label])
            self._command.publish(Float64MultiArray(layout=layout, data=effort))
        elif self._order is None:
            self._command.publish(self._writer.write(stamp, *values))
        else:
            ordered = (each[self._order] for each in values)
            self._command.publish(self._writer.write(stamp, *ordered))

    def look(self, active: bool, measuring: bool) -> dict[str, str]:
        """See that a hold arrives, and look who is there; to be called a few times a second.

        Args:
            active: The arm is under our command.
            measuring: We listen to what it measures: by then DDS knows what the arm listens to.

        Returns:
            By cause, why the arm must not be commanded; ``""``: nothing against it.
        """
        self.hold.look()
        self.rivals.watch(active)
        deaf = measuring and self.is_there() and not self._presence.listens()
        return {
            "others": self.others.reason() if self.others.heard_lately() else "",
            "unheard": self.others.unheard(),
            "hold": self._presence.no_hold_reason() if deaf else "",
            "measured_js": self._presence.two_measure(),
        }

    def measured_elsewhere(self) -> list[str]:
        """Return topics of other namespaces on which an arm is measured, by their full names."""
        return self._presence.elsewhere()

    def commanded_by_others(self) -> bool:
        """Tell whether somebody else has commanded the arm a moment ago."""
        return self.others.heard_lately() or self.rivals.heard_lately()

    def listened(self) -> bool:
        """Tell whether others have had the time to be heard."""
        return self.rivals.listened(self.is_there())
