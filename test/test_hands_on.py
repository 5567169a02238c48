"""An arm with a hand on it, with real processes: stopping, starting, and what others do."""

from __future__ import annotations

import signal
import time

import numpy as np
import pytest
from arm_side import PATIENT, TIMEOUT, FakeArm
from diagnostic_msgs.msg import KeyValue
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool, Empty, Float64, Float64MultiArray, String
from support import CONFIG, MODEL_FILE

from dvrk_gravity import TorqueModel
from dvrk_gravity.ros import COMMANDS, PRIVATE, NodeProcess, private_domain

MODEL = TorqueModel.load(MODEL_FILE)


@pytest.fixture
def start(arm: FakeArm):
    """Start nodes that end with the test."""
    started: list[NodeProcess] = []

    def begin(verb: str, *arguments: str, file=MODEL_FILE, wait: bool = True) -> NodeProcess:
        given = ("--params-file", str(file)) if verb == "compensator" else ()
        node = NodeProcess(verb, *given, *arguments)
        started.append(node)
        if wait and verb == "compensator":
            arm.await_compensator()
        return node

    yield begin
    for node in started:
        node.stop()
        assert "Traceback" not in node.output


def commanding(arm: FakeArm) -> None:
    goal = len(arm.commands) + 20
    arm.run_until(lambda: len(arm.commands) > goal, "commands")


def assert_silent(arm: FakeArm, duration: float = 0.5) -> None:
    """Good input for a while brings no command."""
    arm.client.spin(0.05)  # those on the way
    before = len(arm.commands)
    arm.run(duration)
    assert len(arm.commands) == before


# --- stopping ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "beside",
    [
        {"arm": "mtml"},
        {"nonsense": 1.0},
        *(
            pytest.param(given, marks=pytest.mark.slow)
            for given in ({"timeout": 5.0}, {"use_sim_time": "x"})
        ),
    ],
)
def test_stopping_is_not_refused_for_what_stands_beside_it(arm, start, beside):
    start("compensator", *PATIENT)
    commanding(arm)
    assert not arm.client.set_parameters({"enabled": False, **beside})[0]
    arm.run_until(lambda: bool(arm.holds), "the hold")
    assert_silent(arm)
    assert arm.state.startswith("disabled")


@pytest.mark.parametrize(
    "way",
    ["service", "parameter beside nonsense", pytest.param("parameter", marks=pytest.mark.slow)],
)
def test_stopping_is_never_refused_whatever_has_become_of_the_arm_s_file(arm, start, tmp_path, way):
    description = tmp_path / "arm.yaml"
    description.write_bytes((CONFIG / "arms" / "mtmr.yaml").read_bytes())
    start("compensator", *PATIENT, "-p", f"arm:={description}")
    commanding(arm)
    description.rename(tmp_path / "elsewhere.yaml")
    if way == "service":
        assert arm.client.enable(False).success
    elif way == "parameter":
        assert arm.client.set_parameters({"enabled": False})[0]
    else:
        taken, reason = arm.client.set_parameters({"enabled": False, "beta": [1.0] * 9})
        assert not taken
        assert "10 or 12 or 14" in reason
    arm.run_until(lambda: bool(arm.holds), "the hold")
    assert_silent(arm)
    assert arm.state.startswith("disabled")
    assert arm.client.enable(True).success
    commanding(arm)


def test_an_edited_arm_s_file_does_not_change_a_running_arm_s_limits(arm, start, tmp_path):
    description = tmp_path / "arm.yaml"
    text = (CONFIG / "arms" / "mtmr.yaml").read_text()
    description.write_text(text)
    start("compensator", *PATIENT, "-p", f"arm:={description}")
    commanding(arm)
    shoulder = abs(arm.answer()[1])
    assert shoulder > 0.1
    description.write_text(text.replace("effort_limit: 3.217", "effort_limit: 0.05"))
    assert description.read_text() != text
    assert arm.client.set_parameters({"ramp_time": 0.5})[0]
    assert abs(arm.answer()[1]) == pytest.approx(shoulder, abs=1e-9)


def test_twenty_changes_of_parameters_a_second_starve_no_command(arm, start):
    start("compensator", *PATIENT)
    commanding(arm)
    before, sent = len(arm.commands), arm.sent
    for k in range(20):
        assert arm.client.set_parameters({"ramp_time": 0.5 + 0.01 * k})[0]
        arm.run(0.05)
    arm.client.spin(0.1)
    assert len(arm.commands) - before > 0.8 * (arm.sent - sent)
    assert not arm.holds


@pytest.mark.parametrize(
    "change",
    [{"payload.mass": 0.25}, {"gravity_vector": [0.0, 0.0, 9.81]}, {"gravity_enabled": False}],
)
def test_a_change_beyond_what_a_start_accepts_holds_the_arm_and_is_measured_anew(
    arm, start, change
):
    arm.effort = MODEL.torque(arm.position).tolist()
    start("compensator", *PATIENT)
    commanding(arm)
    before = len(arm.client.states["compensator"])
    assert arm.client.set_parameters(change)[0]
    arm.run_until(lambda: bool(arm.holds), "the hold")
    said = arm.client.states["compensator"][before:]
    assert said[0].startswith("waiting: changed parameters command ")
    assert arm.commands[-1][0] < arm.holds[0] + 0.1
    torque = arm.efforts[-1]
    np.testing.assert_allclose(torque, MODEL.torque(arm.position), atol=0.03)
    if "gravity_enabled" not in change:
        arm.run_until(lambda: arm.state.startswith("fault"), "the refusal")
        assert "parameters have changed, and the measured effort agrees better with" in arm.state
        np.testing.assert_array_equal(arm.efforts[-1], torque)


# --- holding -----------------------------------------------------------------------------------


def test_an_arm_that_nobody_could_hold_is_not_commanded(arm, start):
    arm.turn_deaf()
    start("compensator", *PATIENT)
    arm.run_until(lambda: f"does not subscribe to {PRIVATE}/hold" in arm.state, "the reason")
    assert_silent(arm)
    assert not arm.commands
    arm.listen_to_hold()
    commanding(arm)


@pytest.mark.parametrize("misfit", ["durability", "type"])
def test_a_subscription_to_hold_that_no_hold_reaches_does_not_count(arm, start, misfit):
    arm.turn_deaf()
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    kind, profile = (Empty, latched) if misfit == "durability" else (Bool, QoSProfile(depth=1))
    arm.client.node.create_subscription(kind, "hold", lambda _: None, profile)
    start("compensator", *PATIENT)
    arm.run_until(lambda: f"does not subscribe to {PRIVATE}/hold" in arm.state, "the reason")
    assert_silent(arm)


def test_somebody_else_s_hold_does_not_end_a_hold_that_has_not_arrived(arm, start):
    start("compensator", *PATIENT)
    commanding(arm)
    other = arm.client.node.create_publisher(Empty, "hold", 1)
    arm.client.wait(lambda: other.get_subscription_count() == 2, "both to hear another's hold")
    arm.turn_deaf()
    arm.run_until(lambda: arm.state.startswith("fault"), "the fault")
    other.publish(Empty())
    arm.run(0.5)
    arm.holds.clear()
    arm.listen_to_hold()
    arm.run_until(lambda: bool(arm.holds), "the compensator's hold")


def test_a_hold_is_sent_until_somebody_is_there_to_receive_it(arm, start):
    """The subscriber goes while the arm is commanded, and comes back a second later."""
    start("compensator", *PATIENT)
    commanding(arm)
    arm.turn_deaf()
    arm.run_until(lambda: arm.state.startswith("fault"), "the fault")
    arm.run(1.0)
    assert not arm.holds
    arm.listen_to_hold()
    arm.run_until(lambda: bool(arm.holds), "the hold")
    arm.run(0.5)
    count = len(arm.holds)
    arm.run(0.5)
    assert len(arm.holds) == count  # acknowledged: it does not go on for ever


@pytest.mark.parametrize("way", ["service", "signal"])
def test_a_hold_comes_again_after_the_last_command_has_surely_arrived(arm, start, way):
    """Topics have no order among each other: the arm may take the last effort after the hold."""
    node = start("compensator", *PATIENT)
    commanding(arm)
    if way == "service":
        arm.client.enable(False)
    else:
        node.signal(signal.SIGINT)
    arm.run_until(lambda: bool(arm.holds) and arm.holds[-1] - arm.commands[-1][0] > 0.05, "it")
    arm.run(0.3)
    assert arm.holds[-1] > arm.commands[-1][0]


def test_a_subscriber_that_stands_still_makes_no_storm_of_holds(arm, start):
    """The arm is to obey others again, whoever else listens to hold and does not answer."""
    watchdog = start("watchdog", "-p", f"watchdog_timeout:={TIMEOUT}")
    start("compensator", *PATIENT)
    commanding(arm)
    watchdog.signal(signal.SIGSTOP)
    arm.client.enable(False)
    arm.run(2.0)
    count = len(arm.holds)
    assert 2 <= count < 20
    arm.run(0.5)
    assert len(arm.holds) == count


@pytest.mark.parametrize("verb", ["compensator", "watchdog"])
def test_an_end_whose_hold_reaches_nobody_is_not_status_0(arm, start, verb):
    nodes = {
        "watchdog": start("watchdog", "-p", f"watchdog_timeout:={TIMEOUT}"),
        "compensator": start("compensator", *PATIENT),
    }
    arm.run_until(
        lambda: arm.client.state("watchdog") == "the arm is commanded", "the watchdog's notice"
    )
    arm.turn_deaf()
    if verb == "watchdog":
        nodes["compensator"].process.kill()
    nodes[verb].signal(signal.SIGINT)
    assert nodes[verb].wait() == 1
    assert "hold was not acknowledged" in nodes[verb].output


# --- starting ----------------------------------------------------------------------------------


def test_it_does_not_take_the_arm_out_of_somebody_s_motion(arm, start):
    mover = arm.client.node.create_publisher(JointState, "move_jp", 10)
    on, off = [0.1] * 7, [0.0] * 7
    start("compensator", *PATIENT)
    arm.builtin.publish(arm.message(effort=on))
    arm.run_until(lambda: "use_gravity_compensation" in arm.state, "the refusal")
    mover.publish(JointState())
    arm.builtin.publish(arm.message(effort=off))
    arm.run_until(lambda: arm.state.startswith("fault"), "the fault")
    assert f"commands {PRIVATE}/move_jp" in arm.state
    assert_silent(arm)
    assert not arm.commands
    assert not arm.holds  # it was never ours
    # Told to, it begins once the arm rests.
    arm.client.enable(True)
    for _ in range(60):
        arm.position[1] += 0.005
        arm.run(0.005)
    assert not arm.commands
    commanding(arm)


@pytest.mark.parametrize("topic", ["move_jp", "servo_jf"])
def test_resuming_by_itself_leaves_an_arm_alone_that_somebody_moved_meanwhile(arm, start, topic):
    mover = arm.client.node.create_publisher(JointState, topic, 10)
    start("compensator", *PATIENT, "-p", "resume:=automatic")
    commanding(arm)
    arm.client.wait(lambda: "no valid measured_js" in arm.state, "the fault of the input")
    mover.publish(JointState())
    arm.client.wait(lambda: f"commands {PRIVATE}/{topic}" in arm.state, "the other's command told")
    assert_silent(arm, 1.0)
    arm.client.enable(True)
    commanding(arm)


@pytest.mark.parametrize("durability", ["TRANSIENT_LOCAL", "VOLATILE"])
def test_an_arm_that_says_that_it_is_not_enabled_is_not_commanded(
    arm, start, durability, tmp_path, monkeypatch
):
    """crtk_msgs is not everywhere: any message with two texts serves in its stead."""
    (tmp_path / "crtk_msgs").mkdir()
    (tmp_path / "crtk_msgs" / "msg.py").write_text(
        "from diagnostic_msgs.msg import KeyValue as OperatingState\n"
        "OperatingState.state = property(lambda self: self.key)\n"
        "OperatingState.is_homed = property(lambda self: self.value == 'homed')\n"
        "OperatingState.is_busy = False\n"
    )
    monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=":")
    said = arm.client.node.create_publisher(
        KeyValue, "operating_state", QoSProfile(depth=1, durability=DurabilityPolicy[durability])
    )
    start("compensator", *PATIENT)
    arm.client.wait(lambda: said.get_subscription_count() > 0, "somebody to tell")
    said.publish(KeyValue(key="ENABLED", value="homed"))
    commanding(arm)
    said.publish(KeyValue(key="PAUSED", value="homed"))
    arm.run_until(lambda: "the arm is PAUSED" in arm.state, "the fault")
    arm.run_until(lambda: bool(arm.holds), "the hold")
    arm.client.enable(True)
    assert_silent(arm)
    said.publish(KeyValue(key="ENABLED", value="not yet"))
    arm.run_until(lambda: "not homed" in arm.state, "the other reason")
    said.publish(KeyValue(key="ENABLED", value="homed"))
    commanding(arm)


def test_an_effort_in_other_units_is_a_refusal_that_names_both_numbers(arm, start):
    start("compensator", *PATIENT)
    arm.effort = (1e3 * MODEL.torque(arm.position)).tolist()
    arm.run_until(lambda: arm.state.startswith("fault"), "the refusal")
    assert "as measured" in arm.state
    assert not arm.commands
    assert not arm.holds
    assert not arm.client.enable(True).message.startswith("commanding")
    arm.run_until(lambda: len(refusals(arm)) == 2, "the second refusal")
    arm.effort = MODEL.torque(arm.position).tolist()

    def again() -> bool:
        """Whether it commands; a reading of before that was on its way is refused once more."""
        if arm.state.startswith("fault"):
            arm.client.enable(True)
        return len(arm.commands) > 20

    arm.run_until(again, "commands")


def refusals(arm: FakeArm) -> list[str]:
    return [text for text in arm.client.states["compensator"] if text.startswith("fault")]


def test_a_noisy_effort_biases_the_first_command_by_little(arm, start):
    rng = np.random.default_rng(0)
    held = MODEL.torque(arm.position)
    noise = np.array([0.01, 0.01, 0.008, 0.003, 0.0015, 0.0012, 0.0008])
    start("compensator", *PATIENT)
    end = time.monotonic() + 15.0
    while not arm.commands and time.monotonic() < end:
        arm.run(0.005, effort=(held + noise * rng.standard_normal(7)).tolist())
    assert (np.abs(arm.efforts[0] - held) < noise).all()  # of one sample a third passes that


# --- what others do ------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def crowd():
    """Return an arm, its compensator, and a publisher of every command that has long been there."""
    with private_domain(), FakeArm() as arm:
        node = arm.client.node
        others = {name: node.create_publisher(kind, name, 10) for name, kind in COMMANDS}
        with NodeProcess("compensator", "--params-file", str(MODEL_FILE), *PATIENT):
            arm.await_compensator()
            commanding(arm)
            yield arm, others


def test_every_command_that_an_arm_knows_is_listened_to(crowd):
    arm, others = crowd
    node = arm.client.node
    for name in others:
        listening = node.get_subscriptions_info_by_topic(node.resolve_topic_name(name))
        assert "compensator" in [end.node_name for end in listening], name


# The first of each type of message (hold of those that are empty); the others in trials.
TRIED = {"free", *{kind: name for name, kind in reversed(COMMANDS)}.values()}


@pytest.mark.parametrize(
    ("topic", "kind"),
    [
        pytest.param(name, kind, id=name, marks=() if name in TRIED else pytest.mark.slow)
        for name, kind in COMMANDS
    ],
)
def test_any_command_of_anybody_else_ends_ours_in_a_fault(crowd, topic, kind):
    arm, others = crowd
    arm.run(0.4)  # the last one's command has been heard out
    arm.client.enable(True)
    commanding(arm)
    held = len(arm.holds)
    others[topic].publish(kind())
    arm.run_until(lambda: arm.state.startswith("fault"), "the fault")
    told = "sent hold" if topic == "hold" else f"commands {PRIVATE}/{topic}:"
    assert told in arm.state
    arm.run_until(lambda: len(arm.holds) > held, "the hold")
    assert_silent(arm, 0.2)


@pytest.mark.parametrize("topic", ["servo_cs", "servo_ci"])
def test_who_may_give_commands_that_cannot_be_read_here_is_named_and_waited_for(arm, start, topic):
    """crtk_msgs comes with the dVRK's workspace; the graph lists publishers of any type."""
    node = arm.client.node
    start("compensator", *PATIENT)
    commanding(arm)
    other = node.create_publisher(String, topic, 10)
    arm.run_until(lambda: arm.state.startswith("fault"), "the fault")
    assert f"may command {PRIVATE}/{topic}, whose messages (crtk_msgs/" in arm.state
    arm.run_until(lambda: bool(arm.holds), "the hold")
    arm.client.enable(True)
    assert_silent(arm)
    # DDS learns of a publisher, at which the arm is held, before it learns whose it is.
    named = f"({PRIVATE}/client) may command {PRIVATE}/{topic}"
    arm.run_until(lambda: named in arm.state, "whose publisher it is")
    node.destroy_publisher(other)
    commanding(arm)


@pytest.mark.parametrize("namespace", ["/MTML", "/lab/MTML", "/PSM2", "/ECM"])
def test_a_namespace_that_names_another_arm_is_refused(domain, namespace):
    namespace = f"{PRIVATE}{namespace}"
    node = NodeProcess("compensator", "--params-file", str(MODEL_FILE), namespace=namespace)
    assert node.wait() == 2
    assert f"namespace: got '{namespace}', expected that of arm mtmr, as /MTMR" in node.output


def test_a_best_effort_command_that_a_controller_obeys_is_heard_too(arm, start):
    """Controllers of ros2_control subscribe with the middleware's defaults: DDS's best effort."""
    profile = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
    node = arm.client.node
    rival = node.create_publisher(Float64MultiArray, "commands", profile)
    obeyed: list[Float64MultiArray] = []
    node.create_subscription(Float64MultiArray, "commands", obeyed.append, profile)
    start("compensator", *PATIENT, "-p", "output:=array", wait=False)
    arm.run_until(lambda: len(obeyed) > 20, "commands")
    for _ in range(20):
        rival.publish(Float64MultiArray())
        arm.run(0.01)
    arm.run_until(lambda: f"commands {PRIVATE}/commands" in arm.state, "the fault")
    arm.run_until(lambda: bool(arm.holds), "the hold")


STALLED = """
import sys, time
from dvrk_gravity.compensate.supervisor import Supervisor
from dvrk_gravity.command_line import run
quick, count = Supervisor._follow, 0
def follow(self, *arguments):
    global count
    count += 1
    if count == 50:
        time.sleep(2.5)
    return quick(self, *arguments)
Supervisor._follow = follow
sys.exit(run("dvrk_gravity.ros.verbs:CompensatorVerb", sys.argv[1:]))
"""


def test_a_process_that_stood_still_while_it_answered_sends_no_late_answer(arm):
    program = ("-c", STALLED)
    with NodeProcess(None, "--params-file", str(MODEL_FILE), *PATIENT, program=program) as node:
        arm.await_compensator()
        arm.run_until(lambda: arm.state.startswith("fault"), "the fault")
        arm.run(0.3)
        assert f"no valid measured_js for {TIMEOUT:g} s" in arm.state
        assert len(arm.commands) == 49
        assert arm.holds
    assert node.process.returncode == 0


def test_a_watchdog_that_has_not_told_its_time_out_is_waited_for(arm, start):
    from rclpy.qos import DurabilityPolicy, QoSProfile

    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    watchdog = arm.client.node.create_publisher(Float64, "watchdog_timeout", latched)
    start("compensator", *PATIENT)
    arm.run_until(lambda: "time-out is not known yet" in arm.state, "the reason")
    assert_silent(arm)
    assert not arm.commands
    watchdog.publish(Float64(data=2.0))
    commanding(arm)


def test_the_watchdog_s_time_out_must_fit_and_its_hold_is_the_compensator_s_fault(arm, start):
    """Messages that come slowly suit the one and not the other."""
    watchdog = start("watchdog", "-p", "watchdog_timeout:=0.8")
    arm.client.wait(lambda: bool(arm.client.state("watchdog")), "the watchdog")
    start("compensator", *PATIENT)
    arm.run_until(lambda: "the watchdog holds the arm after 0.8 s" in arm.state, "the reason")
    if arm.commands:  # DDS found the watchdog after the arm: the two met in command
        arm.run_until(lambda: bool(arm.holds), "the hold")
        assert_silent(arm)
    assert arm.client.set_parameters({"timeout": 0.8})[0]
    arm.client.enable(True)
    commanding(arm)
    taken, reason = arm.client.set_parameters({"timeout": 0.9})
    assert not taken
    assert "watchdog" in reason
    watchdog.signal(signal.SIGINT)  # it holds the arm that nobody watches any more
    arm.run_until(lambda: arm.state.startswith("fault"), "the fault")
    assert f"({PRIVATE}/watchdog) sent hold" in arm.state
    assert_silent(arm)


# --- input that cannot be true -------------------------------------------------------------------


def test_two_who_publish_measured_js_are_not_followed(arm, start):
    second = arm.client.node.create_publisher(JointState, "measured_js", 10)
    start("compensator", *PATIENT)
    commanding(arm)  # one that publishes nothing does no harm
    for _ in range(5):
        second.publish(arm.message())
        arm.run(0.01)
    arm.run_until(lambda: arm.state.startswith("fault"), "the fault")
    assert "several nodes" in arm.state
    arm.run_until(lambda: bool(arm.holds), "the hold")
    end = time.monotonic() + 0.5
    before = len(arm.commands)
    arm.client.enable(True)
    while time.monotonic() < end:
        second.publish(arm.message())
        arm.run(0.01)
    assert len(arm.commands) == before
    arm.run_until(lambda: len(arm.commands) > before, "commands when it has ended")


def test_an_encoder_that_jumps_by_thirty_degrees_is_not_followed(arm, start):
    start("compensator", *PATIENT)
    arm.run_until(lambda: arm.state.startswith("commanding"), "the end of the ramp")
    commanding(arm)
    torque = arm.efforts[-1]
    jumped = list(arm.position)
    jumped[2] += np.radians(30.0)
    arm.run_until(lambda: bool(arm.holds), "the hold", position=jumped)
    assert np.abs(arm.efforts[-1] - torque).max() < 1e-6
    arm.client.wait(lambda: arm.state.startswith("fault: no valid measured_js"), "the reason")


def test_a_velocity_that_contradicts_the_positions_drives_no_joint(arm, start):
    from diagnostic_msgs.msg import DiagnosticArray

    told: list[str] = []
    arm.client.node.create_subscription(
        DiagnosticArray, "/diagnostics", lambda m: told.append(m.status[0].message), 10
    )
    start("compensator", *PATIENT)
    commanding(arm)
    at_rest = arm.efforts[-1]
    arm.velocity = [0.0, 3.0, 0.0, 0.0, 0.0, 0.0, 1e6]
    arm.run(0.5)
    np.testing.assert_allclose(arm.efforts[-1], at_rest, atol=1e-9)
    arm.run_until(
        lambda: "velocity of shoulder_pitch, wrist_roll contradicts" in (told or [""])[-1],
        "the warning",
    )
