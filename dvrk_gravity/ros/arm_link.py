"""The link to an arm, for every node that commands one.

It watches who measures the arm and who else commands it, and delivers a hold; nothing else in the
package publishes a motion command.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from std_msgs.msg import Float64MultiArray, MultiArrayDimension, MultiArrayLayout

from dvrk_gravity.arms import Arm
from dvrk_gravity.compensate import Sample, SampleReader, order_mismatch
from dvrk_gravity.ros.foreign_commands import OtherTopicCommands, SameTopicCommands
from dvrk_gravity.ros.hold import Hold
from dvrk_gravity.ros.joint_order_queries import JointOrderQueries
from dvrk_gravity.ros.presence import Presence, on_operating_state
from dvrk_gravity.ros.wire import CommandTopic, CommandWriter, JointStateReader

# DDS repeats lost messages seconds later: an old command must not follow a hold.
_COMMANDS = QoSProfile(depth=10, lifespan=Duration(seconds=0.1))


class ArmLink:
    """Commands one arm, and reports what forbids it.

    Attributes:
        presence: Who measures the arm, and hears a hold.
        hold: Holds the arm, and repeats that until it is acknowledged.
        other_topics: Nodes that command the arm on other topics.
        same_topic: Nodes that command it on ours.
        measured: Joints of ``measured_js``, in its order, in which commands are written.
        extra_joints: Those of them that the arm does not have.
        order_mismatch: Why commands in that order would reach other joints; ``""``: they would not.
        missing_connection: What is missing where the arm measures and does not hear us.
    """

    missing_connection = "nothing subscribes to servo_jp and hold"

    def __init__(
        self,
        node: Node,
        arm: Arm,
        topic: CommandTopic,
        *,
        on_other: Callable[[], None],
        on_same_topic: Callable[[], None],
        on_state: Callable[[str], None],
        margin: NDArray[np.float64] | float = np.inf,
        order: tuple[str, ...] = (),
    ) -> None:
        """Connect the topics of the node's namespace.

        Positions further than ``margin`` (n,), rad or m, outside the arm's limits are refused.
        ``on_other`` is called for a command of another node on another topic than ours,
        ``on_same_topic`` for one on ours, and ``on_state`` with why the arm's operating state
        forbids commands, ``""``: it does not. A person may have stated the ``order`` of joints in
        which commands are taken.
        """
        self._as_array = topic.as_array
        self._command = node.create_publisher(topic.message_type, topic.name, _COMMANDS)
        self.presence = Presence(node, any_subscriber=topic.as_array)
        self.hold = Hold(node, self.presence.arm_hears_hold)
        # Controllers of ros2_control subscribe with DDS's best effort, and obey publishers that a
        # reliable subscription does not hear. An arm's console is reliable.
        reliability = (
            ReliabilityPolicy.BEST_EFFORT if topic.as_array else ReliabilityPolicy.RELIABLE
        )
        self.same_topic = SameTopicCommands(node, self._command, on_same_topic, reliability)
        self.other_topics = OtherTopicCommands(node, self.topic, self.hold.is_echo, on_other)
        on_operating_state(node, on_state)
        self._unpack = JointStateReader().read
        self._read = SampleReader(arm, margin).read
        self._joints, self._fields, self._stated = arm.joint_names, topic.fields, order
        self._joint_order_queries = (
            JointOrderQueries(node, self.topic, order or arm.joint_names, bool(order))
            if topic.as_array
            else None
        )
        self.extra_joints: tuple[str, ...] = ()
        self._set_order(arm.joint_names)

    @property
    def topic(self) -> str:
        """Full name of our command topic."""
        return self._command.topic_name

    def is_connected(self) -> bool:
        """Return whether the arm measures, and receives our commands and a hold."""
        return (
            self.presence.is_there()
            and self._command.get_subscription_count() > 0
            and self.presence.arm_hears_hold()
        )

    def read(self, data: bytes) -> Sample:
        """Return the sample in the bytes of a message of ``measured_js``.

        Raises:
            DroppedSampleError: No command may answer it.
        """
        fields = self._unpack(data)
        sample = self._read(*fields)
        if fields.names is not self.measured:
            self._set_order(fields.names)
        return sample

    def _set_order(self, names: tuple[str, ...]) -> None:
        """Write commands in the stated order, or in that of ``measured_js``.

        Consoles ignore their names. An array is in the model's order if none is stated.
        """
        self.measured = names
        self.extra_joints = tuple(name for name in names if name not in self._joints)
        by_measured = not (self._stated or self._as_array)
        self.order_mismatch = order_mismatch(self._joints, names) if by_measured else ""
        in_order = names if by_measured else self._stated or self._joints
        ours = tuple(name for name in in_order if name in self._joints)
        self._order = None if ours == self._joints else [self._joints.index(name) for name in ours]
        self._writer = CommandWriter(ours, self.same_topic.mark, self._fields)

    def publish(self, stamp: int, *values: Any) -> None:
        """Command the arm: a stamp, ns, and (n,) numbers for each field of its topic."""
        ordered = values if self._order is None else [each[self._order] for each in values]
        if self._as_array:
            (effort,) = ordered
            label = MultiArrayDimension(label=self.same_topic.mark, size=len(effort), stride=1)
            layout = MultiArrayLayout(dim=[label])
            self._command.publish(Float64MultiArray(layout=layout, data=effort))
        else:
            self._command.publish(self._writer.write(stamp, *ordered))

    def look(
        self, active: bool, measuring: bool, watchdogs: Collection[str] = ()
    ) -> dict[str, str]:
        """Repeat a pending hold, and look for other nodes; to be called a few times a second.

        Returns by cause why the arm must not be commanded; ``""``: it may. When we are
        ``measuring``, subscribed to ``measured_js``, DDS knows the arm's subscriptions.
        ``watchdogs`` are full names of nodes that subscribe to commands and apply none.
        """
        self.hold.look()
        self.same_topic.watch(active)
        deaf = measuring and self.presence.is_there() and not self.presence.arm_hears_hold()
        return {
            "others": self.other_topics.reason() if self.other_topics.heard_lately() else "",
            "unheard": self.other_topics.unreadable_commands(),
            "hold": self.presence.no_hold_reason() if deaf else "",
            "joint_order": self.order_mismatch
            if self._joint_order_queries is None
            else self._joint_order_queries.look(active, watchdogs),
            "measured_js": self.presence.publisher_conflict()
            or self.presence.replaced_publisher(active),
        }

    def commanded_by_others(self) -> bool:
        """Return whether another node has just commanded the arm."""
        return self.other_topics.heard_lately() or self.same_topic.heard_lately()

    def freed_by_others(self) -> bool:
        """Return whether another node has just freed the arm."""
        return self.other_topics.heard_lately() and self.other_topics.command == "free"

    def has_listened(self) -> bool:
        """Return whether other nodes have had the time to be heard."""
        return self.same_topic.has_listened(self.presence.is_there())
