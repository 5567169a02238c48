"""The simulator node of an arm that is no master arm."""

from __future__ import annotations

import numpy as np
from made_up_arm import write
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from dvrk_gravity.arms import Arm
from dvrk_gravity.ros import Client, NodeProcess, private_domain
from dvrk_gravity.simulate import PlantFile

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


def test_another_arm_obeys_an_array_and_reads_its_efforts_in_amperes(tmp_path):
    gains = np.array([2.0, 4.0, 5.0, 10.0])
    path = write(tmp_path, {"drive_gains": gains.tolist()})
    start = [0.1, 0.2, 0.1, 0.3]
    given = (f"arm:={path}", "output:=array", f"initial_position:={start}")
    with (
        private_domain(),
        simulator(*given, "builtin_gravity_compensation:=false"),
        User(commands=Float64MultiArray) as user,
    ):
        user.connect()
        made_up = Arm.load(str(path))
        first = user.seen["measured_js"][-1]
        assert tuple(first.name) == made_up.joint_names
        np.testing.assert_allclose(first.position, start, atol=1e-3)
        plant = PlantFile.of(made_up).plant()
        plant.reset(np.array(first.position))
        np.testing.assert_allclose(first.effort, plant.smooth_torque() / gains, atol=1e-3)
        # No effort: the insertion slides by its weight.
        user.send["commands"](Float64MultiArray(data=[0.0] * 4))
        user.wait(lambda: abs(user.position[2] - start[2]) > 0.01, "sliding")
