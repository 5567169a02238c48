"""Released through ROS: a compensator for each release, held at its end, and early if it drifts."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
import pytest
from released import ARM, MODEL, NAMESPACE, patiently
from sensor_msgs.msg import JointState

from dvrk_gravity.compensate import MotionError
from dvrk_gravity.effects import LinearTerm
from dvrk_gravity.ros import Client, listen, on_sample


def test_an_arm_is_moved_and_released_and_held_early_if_it_drifts(rig, tmp_path):
    bad = tmp_path / "bad.yaml"
    weak = tuple(
        term.with_theta(0.4 * term.theta)
        if term.WEIGHT_OF_ARM and isinstance(term, LinearTerm)
        else term
        for term in MODEL.terms
    )
    replace(MODEL, terms=weak).save(bad)
    with rig.driver() as driver:
        pose = driver.connect()
    assert rig.simulated == f"the node {NAMESPACE}/renamed"
    # Were it not ended early, it would last for an hour.
    fallen = patiently(lambda: rig.release(bad, pose, 3600.0))
    assert (fallen > np.radians(4.0) * ARM.scale).any()
    with rig.driver() as driver:
        driver.connect()  # at rest: it is held


def test_a_reading_that_cannot_be_is_neither_a_drift_nor_a_room_of_the_arm(domain):
    heard: list[np.ndarray] = []
    with Client(name="arm") as arm, Client(name="calibrate_release") as client:
        publisher = arm.node.create_publisher(JointState, "measured_js", 100)
        on_sample(client, ARM, lambda sample: heard.append(sample.position))
        arm.wait(lambda: arm.connected(publisher), "the subscription")

        def publish(k: int, pitch: float) -> None:
            message = JointState(name=list(ARM.joint_names), position=[0.0, pitch, 0.0, 0.0])
            stamp = divmod(10**9 + 10_000_000 * k, 10**9)
            message.header.stamp.sec, message.header.stamp.nanosec = stamp
            publisher.publish(message)

        for k in range(60):
            publish(k, {30: 0.5, 40: np.nan}.get(k, 0.0))
            client.spin(0.01)
        client.wait(lambda: len(heard) >= 50, "those after it, too")
        assert not np.any(heard)
        shown = listen(client, ARM)
        next(shown)

        def teach() -> None:
            for k in range(2000):  # from the 20th on, the encoder has slipped
                publish(1000 + k, 0.5 if k >= 20 else 0.0)
                time.sleep(0.01)
                position = next(shown)
                assert position is None or not position.any()

        with pytest.raises(MotionError, match=r"pitch by 0\.5 rad"):
            teach()


def test_of_two_nodes_that_measure_no_room_is_taught(domain):
    with Client(name="arm") as arm, Client(name="played_back") as other, Client() as client:
        nodes = [each.node.create_publisher(JointState, "measured_js", 10) for each in (arm, other)]
        shown = listen(client, ARM)
        next(shown)
        arm.wait(lambda: arm.connected(*nodes), "the subscription")

        def names() -> set[str]:  # they come later than what the nodes publish
            found = client.node.get_publishers_info_by_topic("measured_js")
            return {publisher.node_name for publisher in found}

        client.wait(lambda: {"arm", "played_back"} <= names(), "the names of both nodes")

        def teach() -> None:
            for k in range(500):
                message = JointState(name=list(ARM.joint_names), position=[0.0] * 4)
                message.header.stamp.sec, message.header.stamp.nanosec = divmod(10**7 * k, 10**9)
                nodes[k % 2].publish(message)
                time.sleep(0.01)
                next(shown)

        with pytest.raises(MotionError, match=r"played_back"):
            teach()
