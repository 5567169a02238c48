"""Processes that end, stand still or break: the arm is held, and nothing goes on by itself."""

from __future__ import annotations

import signal

from arm_side import AWAITING, PATIENT, TIMEOUT
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from rclpy.duration import Duration
from rclpy.qos import DurabilityPolicy, QoSProfile
from running import assert_silent, calm, commanding, faulty, held
from sensor_msgs.msg import JointState
from std_msgs.msg import Empty
from support import MODEL_FILE

from dvrk_gravity.compensate import UNWATCHED, Watching
from dvrk_gravity.ros import PRIVATE, Client, NodeProcess

WATCHED = ("-p", f"watchdog_timeout:={TIMEOUT}")


def watched(arm, times: int = 1) -> None:
    """Publish until the watchdog has seen commands begin so often."""
    said = arm.client.states["watchdog"]
    arm.run_until(lambda: said.count("the arm is commanded") >= times, "the watchdog's notice")


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


def test_an_arm_that_vanishes_and_comes_back_is_not_commanded_until_asked(domain):
    quiet = ("-p", "builtin_gravity_compensation:=false")
    given = ("--params-file", str(MODEL_FILE), *PATIENT, "-p", "max_stamp_age:=0.0")
    with Client() as client, NodeProcess("compensator", *given) as compensator:
        heard: dict[str, list[object]] = {"servo_jf": [], "measured_js": [], "hold": []}
        for topic, kept in heard.items():
            kind = Empty if topic == "hold" else JointState
            client.node.create_subscription(kind, topic, kept.append, 100)
        client.watch_state("compensator")

        def commands(more: int):
            goal = len(heard["servo_jf"]) + more
            return lambda: len(heard["servo_jf"]) >= goal

        with NodeProcess("simulator", *quiet) as arm:
            client.wait(commands(50), "commands")
            arm.signal(signal.SIGKILL)
            arm.wait()
            client.wait(lambda: client.state("compensator").startswith("fault"), "the fault")
            client.wait(lambda: bool(heard["hold"]), "the hold")
        gone, before = len(heard["measured_js"]), len(heard["servo_jf"])
        with NodeProcess("simulator", *quiet):
            client.wait(lambda: len(heard["measured_js"]) > gone + 300, "the arm's states again")
            assert len(heard["servo_jf"]) == before
            goal = commands(50)

            def again() -> bool:
                """Whether it commands again; each fault that a stall makes is answered."""
                if client.state("compensator").startswith("fault"):
                    client.enable(True)
                return goal()

            client.wait(again, "commands again", 30.0)
    assert "Traceback" not in compensator.output


def test_an_arm_that_stood_still_is_held_anew_unless_another_moves_it(arm, start):
    """It takes what was sent meanwhile in any order, and may keep the last effort of before."""
    other = arm.client.node.create_publisher(JointState, "move_jp", 10)
    start("compensator")
    for moved in (False, True):
        commanding(arm)
        arm.holds.clear()
        arm.client.wait(lambda: arm.state.startswith("fault") and bool(arm.holds), "the hold")
        if moved:
            arm.client.wait(lambda: arm.client.connected(other), "who listens to others")
            other.publish(JointState())
            other.wait_for_all_acked(Duration(seconds=15.0))
            arm.client.set_parameters({"ramp_time": 1.0})  # what came before its request is done
        calm(arm)
        if moved:
            assert_silent(arm, 0.5)
            assert not arm.holds
        else:
            held(arm)
            assert arm.state.startswith("fault")
            arm.client.enable(True)


# --- programs that break -----------------------------------------------------------------------

BROKEN = """
import sys
from dvrk_gravity.__main__ import main
from dvrk_gravity.compensate.settings import Settings
whole = Settings.parts
def parts(self, q, qd):
    if qd is not None and qd[6] > 1.0:
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
        arm.run_until(lambda: bool(arm.holds), "the hold", velocity=[0.0] * 6 + [2.0])
        assert node.wait(20.0) == 1
        assert "a defect" in node.output


# --- the watchdog and its time-out ---------------------------------------------------------------


def test_who_ends_holds_a_commanded_arm_and_says_by_its_status_whether_that_arrived(arm, start):
    command = arm.client.node.create_publisher(JointState, "servo_jf", 10)
    for deaf in (False, True):
        arm.client.states["watchdog"].clear()
        watchdog = start("watchdog", *WATCHED, wait=False)
        while arm.client.state("watchdog") != "the arm is commanded":
            command.publish(JointState(name=arm.names, effort=[0.0] * 7))
            arm.client.spin(0.01)
        if deaf:
            arm.turn_deaf()
        watchdog.signal(signal.SIGINT)
        if not deaf:
            arm.client.wait(lambda: bool(arm.holds), "the hold")
        assert watchdog.wait(20.0) == int(deaf)
    compensator = start("compensator", wait=False)
    arm.listen_to_hold()
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
    said = Watching(f"{PRIVATE}/client", topic, f"{PRIVATE}/hold", 0.8, heard)
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


def test_a_watchdog_of_another_topic_is_refused_and_one_of_ours_holds_after_a_kill(arm, start):
    """Without any the arm is commanded, and that nothing would hold it is said."""
    obeyed = arm.takes_array(arm.names)
    deaf = start("watchdog", *WATCHED, wait=False)
    compensator = start("compensator", "-p", "output:=array", *AWAITING)
    both = f"{PRIVATE}/servo_jf", f"{PRIVATE}/commands"
    for name in ("compensator", "watchdog"):
        state = arm.client.states[name]
        arm.run_until(lambda said=state: all(token in said[-1] for token in both), "who is deaf")
    arm.run(0.3)
    assert not obeyed
    deaf.stop()
    said = (lambda: arm.state), (lambda: compensator.output)
    arm.run_until(
        lambda: bool(obeyed) and all(UNWATCHED in of() for of in said),
        "commands without a watchdog",
    )
    assert compensator.output.count(UNWATCHED) == 1
    start("watchdog", *WATCHED, "-p", "output:=array", wait=False)
    arm.run_until(lambda: UNWATCHED not in arm.state, "a watchdog of ours")
    watched(arm)
    assert not arm.holds
    compensator.signal(signal.SIGKILL)
    held(arm)
