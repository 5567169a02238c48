"""Processes that end, stand still or break: the arm is held, and nothing goes on by itself."""

from __future__ import annotations

import signal

from arm_side import AWAITING, PATIENT
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from rclpy.qos import DurabilityPolicy, QoSProfile
from running import WATCHED, assert_silent, calm, commanding, faulty, held, watched
from support import MODEL_FILE

from dvrk_gravity.compensate import WatchdogStatus
from dvrk_gravity.ros import PRIVATE, NodeProcess


def test_a_suspended_compensator_is_held_for_and_does_not_go_on_when_it_wakes(arm, start):
    """Before that: the watchdog is killed, and the next one takes over in mid-flight."""
    first = start("watchdog", *WATCHED, wait=False)
    compensator = start("compensator")
    watched(arm)
    first.signal(signal.SIGKILL)
    first.wait()
    commanding(arm)
    start("watchdog", *WATCHED, wait=False)
    watched(arm, 2)
    arm.holds.clear()
    compensator.signal(signal.SIGSTOP)
    held(arm)
    arm.run_until(lambda: arm.client.state("watchdog").startswith("hold sent"), "who held it")
    compensator.signal(signal.SIGCONT)
    faulty(arm)
    assert_silent(arm)
    arm.client.enable(True)
    commanding(arm)
    arm.holds.clear()
    compensator.signal(signal.SIGKILL)
    held(arm)


# --- programs that break -----------------------------------------------------------------------

BROKEN = """
import sys
from dvrk_gravity.__main__ import main
from dvrk_gravity.compensate.settings import Settings
whole = Settings.parts
def parts(self, q, qd):
    if q[6] > 0.21:
        raise RuntimeError('a defect')
    return whole(self, q, qd)
Settings.parts = parts
sys.exit(main())
"""


def test_a_compensator_that_breaks_holds_the_arm_and_ends_with_status_1(arm):
    given = ("--params-file", str(MODEL_FILE), *PATIENT)
    with NodeProcess("compensator", *given, program=("-c", BROKEN)) as node:
        arm.await_compensator()
        commanding(arm)
        assert not arm.holds
        # By its place: a speed is not believed at once where this machine stood still.
        arm.position[6] += 0.02
        arm.run_until(lambda: bool(arm.holds), "the hold")
        assert node.wait(20.0) == 1
        assert "a defect" in node.output


# --- the watchdog and its time-out ---------------------------------------------------------------


def test_who_ends_holds_a_commanded_arm_and_says_by_its_status_whether_that_arrived(arm, start):
    watchdog = start("watchdog", *WATCHED, wait=False)
    compensator = start("compensator")
    watched(arm)
    watchdog.signal(signal.SIGINT)
    held(arm)
    assert watchdog.wait(20.0) == 0
    calm(arm)  # which was another node's
    arm.client.enable(True)
    commanding(arm)
    arm.turn_deaf()
    compensator.signal(signal.SIGINT)
    assert compensator.wait(20.0) == 1


def test_a_watchdog_s_time_out_is_waited_for_and_must_not_be_the_shorter_one(arm, start):
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    watchdog = arm.client.node.create_publisher(DiagnosticStatus, "watchdog_status", latched)
    start("compensator", *AWAITING)
    arm.run_until(lambda: "watchdog" in arm.state, "the reason")
    assert_silent(arm)
    assert not arm.commands
    topic = f"{PRIVATE}/servo_jf"
    infos = arm.client.node.get_publishers_info_by_topic(topic)
    heard = frozenset(bytes(info.endpoint_gid).hex() for info in infos)
    said = WatchdogStatus(f"{PRIVATE}/client", topic, f"{PRIVATE}/hold", 0.8, heard)
    values = [KeyValue(key=key, value=value) for key, value in said.values().items()]
    watchdog.publish(DiagnosticStatus(name=said.node, values=values))
    arm.run_until(lambda: "0.8 s" in arm.state, "the other reason")
    assert_silent(arm)
    assert arm.client.set_parameters({"timeout": 0.8})[0]
    commanding(arm)
    taken, reason = arm.client.set_parameters({"timeout": 0.9})
    assert not taken
    assert "timeout" in reason
    assert not arm.holds
