"""Released through ROS: a compensator for each release, held at its end, and early if it drifts."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

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
MODEL = PlantFile.of(ARM).model
NAMESPACE = f"{PRIVATE}/ECM"


@pytest.fixture
def rig(domain):
    """Return a simulated endoscope arm behind topics."""
    words = ("-p", "arm:=ecm", "-p", "rate:=200.0", "-r", "__node:=renamed")
    with NodeProcess("simulator", *words, namespace=NAMESPACE):
        yield RosRig(ARM, NAMESPACE, TIMEOUT)


def stalled(error: str) -> bool:
    """Return whether this machine stood still for a second: then the arm is held, rightly."""
    return any(words in error for words in ("hold", "was heard", "no valid", "to command"))


def patiently(release: Callable[[], np.ndarray]) -> np.ndarray:
    """Release an arm, and once more where the machine stood still."""
    for _ in range(5):
        try:
            return release()
        except MotionError as error:
            if not stalled(str(error)):
                raise
    raise AssertionError("this machine stands still again and again")


def test_an_arm_is_moved_released_and_held_and_early_if_it_drifts(rig, tmp_path):
    good, bad = tmp_path / "good.yaml", tmp_path / "bad.yaml"
    MODEL.save(good)
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
    held = patiently(lambda: rig.release(good, pose, 1.0))
    assert (held < np.radians(0.5) * ARM.scale).all()
    # Were it not ended early, it would last for an hour.
    fallen = patiently(lambda: rig.release(bad, pose, 3600.0))
    assert (fallen > np.radians(4.0) * ARM.scale).any()
    with rig.driver() as driver:
        driver.connect()  # at rest: it is held


def child(verb: str) -> int | None:
    """Return the process of a node that this one has started, if there is one."""
    for path in Path("/proc/self/task").glob("*/children"):
        for number in path.read_text().split():
            words = Path(f"/proc/{number}/cmdline").read_bytes().split(b"\0")
            if verb.encode() in words:
                return int(number)
    return None


def test_an_arm_that_nobody_compensates_or_watches_any_more_has_no_drift(rig, tmp_path):
    """A held arm does not drift: that says nothing of its model."""
    model = tmp_path / "model.yaml"
    MODEL.save(model)

    def strike(verb: str, number: signal.Signals, ended: threading.Event) -> None:
        with Client(NAMESPACE, "person") as person:
            person.watch_state("compensator")
            while not ended.is_set():
                person.spin(0.05)
                if person.state("compensator").startswith("commanding"):
                    ended.wait(0.5)  # the release has heard it, too
                    if not ended.is_set():
                        os.kill(child(verb) or os.getpid(), number)
                    return

    def struck(verb: str, number: signal.Signals) -> str:
        """Return how a release ends in which that happens."""
        ended = threading.Event()
        thread = threading.Thread(target=strike, args=(verb, number, ended))
        with rig.driver() as driver:
            pose = driver.connect()  # at rest: it is held
        thread.start()
        with pytest.raises((MotionError, KeyboardInterrupt)) as caught:
            rig.release(model, pose, 60.0)
        ended.set()
        thread.join()
        return repr(caught.value)

    for verb, number, says in (
        ("compensator", signal.SIGSTOP, "hold sent"),  # it does not say so itself
        ("watchdog", signal.SIGKILL, "watchdog has ended"),
        ("calibrate", signal.SIGTSTP, "KeyboardInterrupt"),  # Ctrl-Z
    ):
        found: list[str] = []
        while not found or (says not in found[-1] and stalled(found[-1]) and len(found) < 5):
            found.append(struck(verb, number))
        assert says in found[-1], found
    with rig.driver() as driver:
        driver.connect()


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
