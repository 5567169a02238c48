"""Faults of a commanded arm that take long to show, or are rare; others are in test/live."""

from __future__ import annotations

import signal

from arm_side import ALONE, AWAITING, PATIENT, TIMEOUT
from builtin_interfaces.msg import Time
from rclpy.duration import Duration
from rosgraph_msgs.msg import Clock
from running import WATCHED, assert_silent, calm, commanding, held, watched
from sensor_msgs.msg import JointState
from std_msgs.msg import Empty
from support import MODEL_FILE

from dvrk_gravity.compensate import UNWATCHED
from dvrk_gravity.ros import PRIVATE, Client, NodeProcess

SPACE = f"{PRIVATE}/lab"


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


def test_holds_to_a_subscriber_that_stands_still_come_to_an_end(arm, start):
    """The arm is to obey others again; topics have no order: the last command may come late."""
    watchdog = start("watchdog", "-p", f"watchdog_timeout:={TIMEOUT}", wait=False)
    start("compensator")
    commanding(arm)
    watchdog.signal(signal.SIGSTOP)
    arm.client.enable(False)
    arm.run_until(lambda: len(arm.holds) >= 2, "the hold, and again")
    assert arm.holds[-1] > arm.commands[-1][0]
    calm(arm)


def test_all_options_for_a_busy_computer_are_named_at_once_where_the_arm_is_a_simulator(domain):
    model = ("--params-file", str(MODEL_FILE))
    with (
        Client(SPACE) as client,
        NodeProcess(
            "simulator", "-p", "builtin_gravity_compensation:=false", namespace=SPACE
        ) as simulator,
        NodeProcess("compensator", *model, *ALONE, "-p", "ramp_time:=0.0", namespace=SPACE),
    ):
        client.watch_state("compensator")
        began = ("commanding", "fault: no valid measured_js")  # where this computer is that busy
        client.wait(lambda: client.state("compensator").startswith(began), "commands", 60.0)
        simulator.signal(signal.SIGSTOP)
        client.wait(lambda: client.state("compensator").startswith(began[1]), "a fault")
        for option in ("timeout", "max_stamp_age:=0.0", "resume:=automatic", "watchdog_timeout"):
            assert option in client.state("compensator")


def test_a_simulated_clock_is_waited_for_and_its_steps_neither_hide_nor_fake_a_silence(arm, start):
    clock = arm.client.node.create_publisher(Clock, "/clock", 10)
    node = start("compensator", "-p", "use_sim_time:=true")
    arm.run_until(lambda: "(no_clock)" in node.output, "the cause")
    assert not arm.commands
    assert arm.client.set_parameters({"max_stamp_age": 0.0})[0]
    commanding(arm)
    for second in (100, 5000, 3, 100_000):
        clock.publish(Clock(clock=Time(sec=second)))
        commanding(arm)
    assert not arm.holds
    arm.client.wait(lambda: bool(arm.holds), "the hold, while that clock stands still")
