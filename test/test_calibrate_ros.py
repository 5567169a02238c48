"""Released through ROS: a compensator for each release, held at its end, and early if it drifts."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
import pytest
from conftest import TIMEOUT
from sensor_msgs.msg import JointState

from dvrk_gravity.arms import Arm
from dvrk_gravity.compensate import MotionError
from dvrk_gravity.effects import LinearTerm
from dvrk_gravity.ros import PRIVATE, Client, NodeProcess, RosRig, on_position
from dvrk_gravity.simulate import PlantFile

ARM = Arm.load("ecm")
NAMESPACE = f"{PRIVATE}/ECM"


@pytest.fixture
def rig(domain):
    """Return a simulated endoscope arm behind topics."""
    words = ("-p", "arm:=ecm", "-p", "rate:=200.0", "-r", "__node:=renamed")
    with NodeProcess("simulator", *words, namespace=NAMESPACE):
        yield RosRig(ARM, NAMESPACE, TIMEOUT)


def test_an_arm_is_moved_released_and_held_and_early_if_it_drifts(rig, tmp_path):
    model = PlantFile.of(ARM).model
    good, bad = tmp_path / "good.yaml", tmp_path / "bad.yaml"
    model.save(good)
    weak = tuple(
        term.with_theta(0.4 * term.theta)
        if term.WEIGHT_OF_ARM and isinstance(term, LinearTerm)
        else term
        for term in model.terms
    )
    replace(model, terms=weak).save(bad)
    with rig.driver() as driver:
        pose = driver.connect()
    assert rig.simulated == f"the node {NAMESPACE}/renamed"
    assert (rig.release(good, pose, 1.0) < np.radians(0.5) * ARM.scale).all()
    begun = time.monotonic()
    assert (rig.release(bad, pose, 60.0) > np.radians(4.0) * ARM.scale).any()
    assert time.monotonic() - begun < 50.0
    with rig.driver() as driver:
        driver.connect()  # at rest: it is held


def test_a_release_in_which_nothing_is_heard_is_no_drift_of_zero(rig, tmp_path, monkeypatch):
    model = tmp_path / "model.yaml"
    PlantFile.of(ARM).model.save(model)
    monkeypatch.setattr("dvrk_gravity.ros.rig.on_position", lambda client, arm, receive: None)
    with rig.driver() as driver:
        pose = driver.connect()
    with pytest.raises(MotionError, match="how far it drifted is not known"):
        rig.release(model, pose, 5.0)


@pytest.mark.parametrize("wrong", [0.5, np.nan], ids=["impossible", "no number"])
def test_a_reading_that_cannot_be_is_no_drift(domain, wrong):
    heard: list[np.ndarray] = []
    with Client(name="arm") as arm, Client(name="calibrate_release") as client:
        publisher = arm.node.create_publisher(JointState, "measured_js", 10)
        on_position(client, ARM, heard.append)
        arm.wait(lambda: arm.connected(publisher), "the subscription")
        for k in range(60):
            message = JointState(name=list(ARM.joint_names), position=[0.0] * ARM.n)
            message.header.stamp.sec, message.header.stamp.nanosec = 1, 10_000_000 * k
            if k == 40:
                message.position[1] = wrong
            publisher.publish(message)
            client.spin(0.01)
        client.wait(lambda: len(heard) >= 20, "those after it, too")
    assert not np.any(heard)
