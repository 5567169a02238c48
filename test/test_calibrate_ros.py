"""Released through ROS: a compensator for each release, held at its end, and early if it drifts."""

from __future__ import annotations

import os
import signal
import threading
import time
from dataclasses import replace

import numpy as np
import pytest
from arm_side import TIMEOUT
from sensor_msgs.msg import JointState

from dvrk_gravity.arms import Arm
from dvrk_gravity.compensate import MotionError
from dvrk_gravity.effects import LinearTerm
from dvrk_gravity.ros import PRIVATE, Client, NodeProcess, RosRig, listen, on_sample
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
    monkeypatch.setattr("dvrk_gravity.ros.rig.on_sample", lambda client, arm, receive: None)
    with rig.driver() as driver:
        pose = driver.connect()
    with pytest.raises(MotionError, match="how far it drifted is not known"):
        rig.release(model, pose, 5.0)


@pytest.mark.parametrize("wrong", [0.5, np.nan], ids=["impossible", "no number"])
def test_a_reading_that_cannot_be_is_no_drift(domain, wrong):
    heard: list[np.ndarray] = []
    with Client(name="arm") as arm, Client(name="calibrate_release") as client:
        publisher = arm.node.create_publisher(JointState, "measured_js", 10)
        on_sample(client, ARM, lambda sample: heard.append(sample.position))
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


STRIKES = [
    ("compensator", signal.SIGKILL, MotionError, "the compensator has ended"),
    ("compensator", signal.SIGSTOP, MotionError, "hold sent"),
    ("watchdog", signal.SIGKILL, MotionError, "the watchdog has ended"),
    ("calibrate", signal.SIGTSTP, KeyboardInterrupt, None),  # Ctrl-Z
]


def test_an_arm_that_nobody_compensates_or_watches_any_more_has_no_drift(
    rig, tmp_path, monkeypatch
):
    """A held arm does not drift: that says nothing of its model."""
    model = tmp_path / "model.yaml"
    PlantFile.of(ARM).model.save(model)
    started: dict[str, NodeProcess] = {}

    class Noted(NodeProcess):
        def __init__(self, name: str, *words: str, **how: object) -> None:
            super().__init__(name, *words, **how)
            started[name] = self

    def strike(verb: str, number: signal.Signals) -> None:
        end = time.monotonic() + 30.0
        while time.monotonic() < end:
            if "compensator" in started and "compensating" in started["compensator"].output:
                pid = started[verb].process.pid if verb in started else os.getpid()
                os.kill(pid, number)
                break
            time.sleep(0.05)

    monkeypatch.setattr("dvrk_gravity.ros.rig.NodeProcess", Noted)
    with rig.driver() as driver:
        pose = driver.connect()
    for verb, number, error, says in STRIKES:
        started.clear()
        thread = threading.Thread(target=strike, args=(verb, number), daemon=True)
        thread.start()
        with pytest.raises(error, match=says):
            rig.release(model, pose, 5.0)
        thread.join()
        with rig.driver() as driver:
            pose = driver.connect()  # at rest: it is held


def test_a_watchdog_that_has_held_the_arm_before_forbids_no_release(rig, tmp_path):
    model = tmp_path / "model.yaml"
    PlantFile.of(ARM).model.save(model)
    with (
        NodeProcess("watchdog", "-p", "watchdog_timeout:=1.0", namespace=NAMESPACE),
        Client(NAMESPACE, "person") as person,
    ):
        person.watch_state("watchdog")
        publisher = person.node.create_publisher(JointState, "servo_jf", 10)
        person.wait(lambda: person.state("watchdog").startswith("watching"), "the watchdog")
        while not person.state("watchdog").startswith("hold sent"):
            if not person.state("watchdog").startswith("the arm is commanded"):
                publisher.publish(JointState(effort=[0.0] * ARM.n))
            person.spin(0.05)
        person.node.destroy_publisher(publisher)
        person.spin(3.0)  # until its hold is forgotten
        with rig.driver() as driver:
            pose = driver.connect()
        assert (rig.release(model, pose, 1.0) < np.radians(0.5) * ARM.scale).all()


def test_an_arm_whose_clock_is_slow_is_released_for_as_long_by_its_own(rig, tmp_path, monkeypatch):
    model = tmp_path / "model.yaml"
    PlantFile.of(ARM).model.save(model)
    stamps: list[int] = []

    def slowly(client, arm, receive):
        def slow(sample):
            stamps.append(sample.stamp // 5)
            receive(replace(sample, stamp=stamps[-1]))

        on_sample(client, arm, slow)

    monkeypatch.setattr("dvrk_gravity.ros.rig.on_sample", slowly)
    with rig.driver() as driver:
        pose = driver.connect()
    rig.release(model, pose, 1.0)
    assert stamps[-1] - stamps[0] > 1_000_000_000


def test_an_encoder_that_slips_while_corners_are_taught_is_no_room_of_the_arm(domain):
    with Client(name="arm") as arm, Client(name="collect") as client:
        publisher = arm.node.create_publisher(JointState, "measured_js", 10)
        shown = listen(client, ARM)
        next(shown)
        arm.wait(lambda: arm.connected(publisher), "the subscription")

        def teach() -> None:
            for k in range(60):
                message = JointState(name=list(ARM.joint_names), position=[0.0] * ARM.n)
                message.header.stamp.sec, message.header.stamp.nanosec = 1, 10_000_000 * k
                message.position[1] = 0.5 if k >= 20 else 0.0
                publisher.publish(message)
                end = time.monotonic() + 0.01
                while time.monotonic() < end:
                    position = next(shown)
                    assert position is None or not position.any()

        with pytest.raises(MotionError, match=r"pitch by 0\.5 rad"):
            teach()
