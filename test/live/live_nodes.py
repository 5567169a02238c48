"""Fixtures of live tests: a ROS domain that nobody else uses, an arm in it, and nodes."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import pytest
from arm_side import PATIENT, TIMEOUT, FakeArm
from driven_arm import DrivenArm
from released import ARM, NAMESPACE
from running import MODEL
from support import MODEL_FILE, REPOSITORY

from dvrk_gravity.ros import ENVIRONMENT, NodeProcess, RosRig, private_domain


@pytest.fixture(scope="session", autouse=True)
def quick_discovery() -> Iterator[None]:
    """Let nodes that were not heard at first announce themselves again after 0.1 s, not 3 s."""
    with pytest.MonkeyPatch.context() as patch:
        profile = REPOSITORY / "test" / "live" / "discovery.xml"
        patch.setitem(ENVIRONMENT, "FASTRTPS_DEFAULT_PROFILES_FILE", str(profile))
        yield


@pytest.fixture
def domain() -> Iterator[int]:
    """Return a ROS domain that no other test, demo or benchmark uses at the same time."""
    with private_domain() as number:
        yield number


@pytest.fixture
def arm(domain: int) -> Iterator[FakeArm]:
    """Return the arm's side of the compensator's topics."""
    with FakeArm() as fake:
        yield fake


@pytest.fixture
def start(arm: FakeArm) -> Iterator[Callable[..., NodeProcess]]:
    """Start nodes that end with the test; whatever happened, every command was a safe one."""
    started: list[NodeProcess] = []

    def begin(verb: str, *arguments: str, wait: bool = True, **options) -> NodeProcess:
        given = ("--params-file", str(MODEL_FILE), *PATIENT) if verb == "compensator" else ()
        node = NodeProcess(verb, *given, *arguments, **options)
        started.append(node)
        if wait:
            arm.await_compensator("commands" if "output:=array" in arguments else "servo_jf")
        return node

    yield begin
    for node in started:
        node.stop()
        assert "Traceback" not in node.output
    for _, message in arm.commands:
        by_name = dict(zip(message.name, message.effort, strict=True))
        effort = np.array([by_name[name] for name in MODEL.arm.joint_names])
        assert np.isfinite(effort).all()
        motor = MODEL.arm.actuator_effort(effort)
        assert (np.abs(effort) <= MODEL.arm.effort_limit + 1e-9).all()
        assert (np.abs(motor) <= MODEL.arm.actuator_effort_limit + 1e-9).all()


@pytest.fixture
def driven(domain: int) -> Iterator[DrivenArm]:
    with DrivenArm() as arm:
        yield arm


@pytest.fixture
def rig(domain: int) -> Iterator[RosRig]:
    """Return a simulated endoscope arm behind topics."""
    words = ("-p", "arm:=ecm", "-p", "rate:=200.0", "-r", "__node:=renamed")
    with NodeProcess("simulator", *words, namespace=NAMESPACE):
        yield RosRig(ARM, NAMESPACE, TIMEOUT)


@pytest.fixture
def patience(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let a busy machine suspend what moves the arm for a while."""
    monkeypatch.setattr("dvrk_gravity.ros.mover.ASLEEP", 2.0)
