"""A simulator's process, and a user of the arm that it simulates."""

from __future__ import annotations

import numpy as np
from sensor_msgs.msg import JointState

from dvrk_gravity.ros import Client, NodeProcess

STATES = ("measured_js", "setpoint_js", "gravity_compensation/setpoint_js")


def simulator(*parameters: str, **options) -> NodeProcess:
    arguments = [word for parameter in parameters for word in ("-p", parameter)]
    return NodeProcess("simulator", *arguments, **options)


class User(Client):
    """A user of the arm, who sees ``seen`` by topic and publishes by ``send``."""

    def __init__(self, **commands: type) -> None:
        super().__init__()
        self.seen: dict[str, list[JointState]] = {topic: [] for topic in STATES}
        for topic, kept in self.seen.items():
            self.node.create_subscription(JointState, topic, kept.append, 100)
        made = {name: self.node.create_publisher(kind, name, 10) for name, kind in commands.items()}
        self.send = {name: topic.publish for name, topic in made.items()}
        self.topics = made.values()

    def connect(self) -> None:
        self.wait(lambda: self.connected(*self.topics) and all(self.seen.values()), "the arm")

    def fresh(self, topic: str, count: int = 1) -> JointState:
        """Return a message that comes after some others."""
        goal = len(self.seen[topic]) + count
        self.wait(lambda: len(self.seen[topic]) >= goal, f"{count} of {topic}")
        return self.seen[topic][-1]

    @property
    def position(self) -> np.ndarray:
        return np.array(self.seen["measured_js"][-1].position)

    def speed(self, count: int = 100) -> float:
        """Return the largest of the last so many samples, rad/s."""
        return float(np.abs([m.velocity for m in self.seen["measured_js"][-count:]]).max())
