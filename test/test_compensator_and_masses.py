"""The compensator's process refuses a model that the masses in the arm's file contradict.

Reading and model agree, for both are of the same wrong scale.
"""

from __future__ import annotations

import time

import numpy as np
import pytest
from robots import UR5

from dvrk_gravity.arms import Arm
from dvrk_gravity.model import TorqueModel, stated_weight
from dvrk_gravity.ros import PRIVATE, NodeProcess

POSE = np.array([0.2, -0.8, 1.1, -0.4, 0.5, 0.1])


def scaled(path, factor: float, **further: str) -> None:
    """Write the model of a UR5 by efforts of another scale, as it was identified once."""
    model = TorqueModel.stated(UR5)
    values = {
        name: tuple(factor * np.array(value)) if name.startswith("link_") else value
        for name, value in model.parameters().items()
    }
    TorqueModel.from_parameters({**values, "identification.verdict": "good", **further}).save(path)


def state_of(file, effort: np.ndarray, until: str) -> tuple[str, int]:
    """Return what a compensator says of an arm that reads such efforts, and how often it commands.

    Args:
        file: The model's.
        effort: (n,) N·m as read.
        until: Beginning of the state to wait for.
    """
    from sensor_msgs.msg import JointState
    from std_msgs.msg import Empty, Float64MultiArray

    from dvrk_gravity.ros import Client

    commands: list[object] = []
    settings = ("output:=array", "timeout:=1.0", "max_stamp_age:=0.0")
    arguments = [part for setting in settings for part in ("-p", setting)]
    with (
        Client(f"{PRIVATE}/arm") as client,
        NodeProcess(
            "compensator", "--params-file", str(file), *arguments, namespace=f"{PRIVATE}/arm"
        ),
    ):
        measured = client.node.create_publisher(JointState, "measured_js", 10)
        client.node.create_subscription(Float64MultiArray, "commands", commands.append, 10)
        client.node.create_subscription(Empty, "hold", lambda _: None, 10)
        client.watch_state("compensator")
        client.wait(
            lambda: client.state("compensator") != "" and client.connected(measured), "the node"
        )
        message = JointState(
            name=Arm.load(UR5).joint_names, position=POSE.tolist(), velocity=[0.0] * 6,
            effort=effort.tolist(),
        )  # fmt: skip

        def told() -> bool:
            now = time.time_ns()
            message.header.stamp.sec, message.header.stamp.nanosec = divmod(now, 1_000_000_000)
            measured.publish(message)
            client.spin(0.005)
            return client.state("compensator").startswith(until)

        client.wait(told, until)
        return client.state("compensator"), len(commands)


@pytest.mark.parametrize("factor", [0.1, 3.0])
def test_a_model_that_agrees_with_a_wrong_reading_is_refused(domain, tmp_path, factor):
    del domain
    scaled(tmp_path / "model.yaml", factor)
    weight = stated_weight(Arm.load(UR5), POSE)
    said, commands = state_of(tmp_path / "model.yaml", factor * weight, "fault")
    assert f"the model holds {factor:g} times what the masses in the arm's file weigh here" in said
    assert "effort_unit: N·m in the model's file" in said
    assert not commands


def test_what_is_said_to_be_in_newton_metres_is_believed_and_starts(domain, tmp_path):
    del domain
    scaled(tmp_path / "model.yaml", 0.3, effort_unit="N·m")
    weight = stated_weight(Arm.load(UR5), POSE)
    said, _ = state_of(tmp_path / "model.yaml", 0.3 * weight, "commanding")
    assert said
