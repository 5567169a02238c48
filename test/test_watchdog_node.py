"""The watchdog as a process of its own: it holds the arm when commands stop without a hold."""

from __future__ import annotations

import time

import pytest
from arm_side import PATIENT, TIMEOUT
from sensor_msgs.msg import JointState
from std_msgs.msg import Empty
from support import MODEL_FILE

from dvrk_gravity.ros import NodeProcess


@pytest.fixture
def commander(arm):
    """Return a function that publishes a command, once a watchdog listens."""
    node = arm.client.node
    command = node.create_publisher(JointState, "servo_jf", 10)
    hold = node.create_publisher(Empty, "hold", 10)

    def ready():
        arm.client.wait(
            lambda: (
                arm.client.state("watchdog").startswith("watching")
                # Each topic is heard by this test and by the watchdog.
                and command.get_subscription_count() == 2
                and hold.get_subscription_count() == 2
            ),
            "the watchdog",
        )
        return command, hold

    return ready


def silence_after(arm, command, count: int) -> float:
    for _ in range(count):
        command.publish(JointState(effort=[0.0] * 7))
        arm.client.spin(0.01)
    return time.monotonic()


def test_it_holds_within_its_time_when_commands_stop(arm, commander):
    with NodeProcess("watchdog", "-p", "watchdog_timeout:=0.2") as node:
        command, _ = commander()
        delays: list[float] = []
        # A machine that stands still delays one of them, not each.
        while len(delays) < 3 and min(delays, default=1.0) > 0.5:
            silence = silence_after(arm, command, 20)
            arm.holds.clear()
            arm.client.wait(lambda: bool(arm.holds), "the hold")
            delays.append(arm.holds[0] - silence)
        assert 0.15 < min(delays) < 0.5
        arm.client.wait(lambda: arm.client.state("watchdog").startswith("hold sent"), "what it did")
    assert node.process.returncode == 0


def test_it_leaves_an_arm_alone_that_was_never_commanded(arm, commander):
    with NodeProcess("watchdog", "-p", "watchdog_timeout:=0.05"):
        commander()
        arm.client.spin(0.4)
        assert not arm.holds


def test_commands_that_end_with_a_hold_need_no_other(arm, commander):
    with NodeProcess("watchdog", "-p", f"watchdog_timeout:={TIMEOUT}"):
        command, hold = commander()
        silence_after(arm, command, 10)
        hold.publish(Empty())
        arm.client.spin(1.5 * TIMEOUT)
        assert len(arm.holds) == 1  # the one sent here


def test_it_holds_the_arm_of_a_compensator_that_was_killed(arm):
    with (
        NodeProcess("watchdog", "-p", f"watchdog_timeout:={TIMEOUT}"),
        NodeProcess("compensator", "--params-file", str(MODEL_FILE), *PATIENT) as compensator,
    ):
        arm.await_compensator()
        arm.run_until(
            lambda: arm.client.state("watchdog") == "the arm is commanded", "the watchdog"
        )
        compensator.process.kill()
        arm.run_until(lambda: bool(arm.holds), "the hold")


def test_a_watchdog_that_is_ended_does_not_leave_a_commanded_arm_unwatched(arm, commander):
    with NodeProcess("watchdog", "-p", f"watchdog_timeout:={TIMEOUT}") as node:
        command, _ = commander()
        # A reader may learn of its writer after the writer did of it.
        while arm.client.state("watchdog") != "the arm is commanded":
            silence_after(arm, command, 10)
        node.stop()
        arm.client.wait(lambda: bool(arm.holds), "the hold")
