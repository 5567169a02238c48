"""Nodes under test: how they are started, and what a test of any of them asks."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
from arm_side import PATIENT, FakeArm, stamp_of
from support import MODEL_FILE

from dvrk_gravity import TorqueModel
from dvrk_gravity.ros import NodeProcess

MODEL = TorqueModel.load(MODEL_FILE)
AT_ONCE = ("-p", "ramp_time:=0.0", "-p", "slew_limit:=[0.,0.,0.,0.,0.,0.,0.]")


@contextmanager
def nodes_of(arm: FakeArm) -> Iterator[Callable[..., NodeProcess]]:
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


def expected(arm: FakeArm) -> np.ndarray:
    """The model's torque at what the arm measures."""
    return MODEL.torque(arm.position, arm.velocity)


def answers_since(arm: FakeArm, stamp: int) -> int:
    """How many commands answer a message that was sent after a stamp."""
    return sum(stamp_of(message) > stamp for _, message in arm.commands)


def commanding(arm: FakeArm, more: int = 20) -> None:
    """Publish until so many messages have been answered from now on.

    A machine that stands still for longer than the time-out has the arm held: that is answered as a
    person would.
    """
    mark = arm.stamp

    def answered() -> bool:
        if arm.state.startswith("fault: no valid measured_js"):
            arm.client.enable(True)
        return answers_since(arm, mark) >= more

    arm.run_until(answered, "commands")


def assert_silent(arm: FakeArm, duration: float = 0.3, **fields) -> None:
    """Good input for a while is not answered, neither at once nor late."""
    mark = arm.stamp
    arm.run(duration, **fields)
    arm.client.spin(0.1)
    assert answers_since(arm, mark) == 0


def held(arm: FakeArm) -> None:
    """Publish until the arm is held once more, or has been since the holds were cleared."""
    arm.run_until(lambda: bool(arm.holds), "the hold")


def calm(arm: FakeArm) -> None:
    """Wait until no hold is on its way any more, and forget those that came."""
    arm.holds.append(0.0)
    while arm.holds:
        arm.holds.clear()
        arm.client.spin(0.4)


def faulty(arm: FakeArm, *tokens: str) -> None:
    """Publish until the compensator reports a fault that names all of these."""
    arm.run_until(
        lambda: arm.state.startswith("fault") and all(token in arm.state for token in tokens),
        f"a fault with {tokens}",
    )
