"""What a test of any node asks."""

from __future__ import annotations

import numpy as np
from arm_side import TIMEOUT, FakeArm, stamp_of
from support import MODEL_FILE

from dvrk_gravity import TorqueModel

MODEL = TorqueModel.load(MODEL_FILE)
AT_ONCE = ("-p", "ramp_time:=0.0", "-p", "slew_limit:=[0.,0.,0.,0.,0.,0.,0.]")
WATCHED = ("-p", f"watchdog_timeout:={TIMEOUT}")


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


def watched(arm: FakeArm, times: int = 1) -> None:
    """Publish until the watchdog has seen commands begin so often."""
    said = arm.client.states["watchdog"]
    arm.run_until(lambda: said.count("the arm is commanded") >= times, "the watchdog's notice")
