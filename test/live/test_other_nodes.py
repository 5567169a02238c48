"""Other nodes at the same arm: whoever commands or measures it, hears a hold, or does not."""

from __future__ import annotations

import time

from arm_side import FakeArm
from diagnostic_msgs.msg import KeyValue
from rclpy.qos import DurabilityPolicy, QoSProfile
from running import assert_silent, calm, commanding, faulty, held
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool, Empty, String

from dvrk_gravity.ros import COMMANDS, PRIVATE

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def senders(arm: FakeArm, since: float = 0.0) -> set[str]:
    """Marks of all who have commanded since a time."""
    return {message.header.frame_id for when, message in arm.commands if when > since}


# --- who commands ------------------------------------------------------------------------------


def test_a_second_compensator_refuses_and_takes_over_only_when_asked(arm, start):
    arm.client.watch_state("second")
    start("compensator")
    commanding(arm)
    (first,) = senders(arm)
    start("compensator", "-r", "__node:=second", wait=False)
    arm.run_until(lambda: arm.client.state("second").startswith("fault"), "the refusal")
    assert f"{PRIVATE}/servo_jf" in arm.client.state("second")
    assert not arm.holds  # that would take the arm out of the first's hands
    assert not arm.client.enable(True, "second").success
    refused = time.monotonic()
    commanding(arm, 50)
    assert senders(arm, refused) == {first}
    arm.client.enable(False)
    arm.run(0.5)
    assert_silent(arm)
    assert arm.client.enable(True, "second").success
    commanding(arm)
    assert len(senders(arm) - {first}) == 1


def test_of_two_that_start_at_once_no_two_go_on(arm, start):
    arm.client.watch_state("second")
    start("compensator", wait=False)
    start("compensator", "-r", "__node:=second", wait=False)
    states = arm.client.states
    arm.run_until(lambda: bool(states["compensator"] and states["second"]), "both")

    def faults() -> list[bool]:
        return [arm.client.state(name).startswith("fault") for name in ("compensator", "second")]

    arm.run_until(lambda: any(faults()), "one that gives way")
    # The one that started first goes on; where each heard the other first, both give way.
    for _ in range(3):
        mark = time.monotonic()
        arm.run(0.3)
        late = mark + 0.1  # those on the way
        assert len(senders(arm, late)) <= 2 - sum(faults())


def test_any_command_of_another_node_ends_ours_and_nothing_resumes_by_itself(arm, start):
    """All are heard; a motion and a hold are tried."""
    node = arm.client.node
    others = {name: node.create_publisher(kind, name, 10) for name, kind in COMMANDS}
    start("compensator", "-p", "resume:=automatic")
    commanding(arm)  # beside idle clients
    assert not arm.holds
    for name in others:
        listening = node.get_subscriptions_info_by_topic(node.resolve_topic_name(name))
        assert "compensator" in [end.node_name for end in listening], name
    for topic in ("move_jp", "hold"):
        calm(arm)
        arm.client.enable(True)
        commanding(arm)
        others[topic].publish(dict(COMMANDS)[topic]())
        faulty(arm, f"{PRIVATE}/{topic}")
        held(arm)
        assert_silent(arm, 0.5)
    # An input that stops is a fault that ends by itself, but not where the arm was moved meanwhile.
    arm.client.enable(True)
    commanding(arm)
    arm.client.wait(lambda: "no valid measured_js" in arm.state, "the fault of the input")
    others["move_jp"].publish(JointState())
    arm.client.wait(lambda: f"{PRIVATE}/move_jp" in arm.state, "the other's command")
    assert_silent(arm, 1.0)


def test_who_may_give_commands_that_cannot_be_read_here_is_named_and_waited_for(arm, start):
    """crtk_msgs comes with the dVRK's workspace; the graph lists publishers of any type."""
    start("compensator")
    commanding(arm)
    other = arm.client.node.create_publisher(String, "servo_cs", 10)
    faulty(arm, f"{PRIVATE}/servo_cs")
    held(arm)
    arm.client.enable(True)
    assert_silent(arm)
    # DDS learns of a publisher, at which the arm is held, before it learns whose it is.
    arm.run_until(lambda: f"{PRIVATE}/client" in arm.state, "whose publisher it is")
    arm.client.node.destroy_publisher(other)
    commanding(arm)


# --- who measures, and whether the arm may be commanded -------------------------------------------


def test_two_who_publish_measured_js_are_not_followed(arm, start):
    second = arm.client.node.create_publisher(JointState, "measured_js", 10)
    start("compensator")
    commanding(arm)  # one that publishes nothing does no harm

    def both() -> bool:
        second.publish(arm.message())
        return arm.state.startswith("fault") and bool(arm.holds)

    arm.run_until(both, "the fault")
    assert f"{PRIVATE}/measured_js" in arm.state
    arm.client.enable(True)
    commanding(arm)  # when it has ended


def test_an_arm_that_says_that_it_is_not_enabled_is_not_commanded(
    arm, start, tmp_path, monkeypatch
):
    """crtk_msgs is not everywhere: any message with two texts serves in its stead."""
    (tmp_path / "crtk_msgs").mkdir()
    (tmp_path / "crtk_msgs" / "msg.py").write_text(
        "from diagnostic_msgs.msg import KeyValue as OperatingState\n"
        "OperatingState.state = property(lambda self: self.key)\n"
        "OperatingState.is_homed = property(lambda self: self.value == 'homed')\n"
        "OperatingState.is_busy = property(lambda self: self.value == 'busy')\n"
    )
    monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=":")
    start("compensator")
    volatile = QoSProfile(depth=1)
    for profile, state in ((LATCHED, ("PAUSED", "homed")), (volatile, ("ENABLED", "not yet"))):
        said = arm.client.node.create_publisher(KeyValue, "operating_state", profile)
        expected = 2 if profile is LATCHED else 1
        arm.client.wait(lambda n=expected, s=said: s.get_subscription_count() == n, "who is told")
        said.publish(KeyValue(key="ENABLED", value="homed"))
        commanding(arm)
        arm.holds.clear()
        said.publish(KeyValue(key=state[0], value=state[1]))
        faulty(arm, "operating_state")
        held(arm)
        arm.client.enable(True)
        assert_silent(arm)
        arm.client.node.destroy_publisher(said)


# --- who hears a hold --------------------------------------------------------------------------


def test_an_arm_that_nobody_could_hold_is_not_commanded_and_a_hold_is_repeated_until_heard(
    arm, start
):
    arm.turn_deaf()
    node = arm.client.node
    start("compensator", wait=False)
    arm.run_until(lambda: f"{PRIVATE}/hold" in arm.state, "the reason")
    for kind, profile in ((Bool, QoSProfile(depth=1)), (Empty, LATCHED)):  # no hold reaches these
        misfit = node.create_subscription(kind, "hold", lambda _: None, profile)
        assert_silent(arm, 0.5)
        assert f"{PRIVATE}/hold" in arm.state
        node.destroy_subscription(misfit)
    arm.listen_to_hold()
    commanding(arm)
    # Nobody is there when it is sent; somebody else's hold does not end it.
    other = node.create_publisher(Empty, "hold", 1)
    arm.run_until(lambda: arm.client.connected(other), "who hears another's hold")
    arm.turn_deaf()
    arm.client.wait(lambda: arm.state.startswith("fault"), "the fault")
    other.publish(Empty())
    arm.run(0.5)
    arm.holds.clear()
    arm.listen_to_hold()
    held(arm)
    calm(arm)  # acknowledged: it does not go on for ever
