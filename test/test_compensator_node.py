"""The compensator as a process of its own, over real DDS: each behaviour, seen from outside."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from arm_side import PATIENT, TIMEOUT, FakeArm
from support import CONFIG, MODEL_FILE

from dvrk_gravity import TorqueModel
from dvrk_gravity.arms import JOINT_NAMES
from dvrk_gravity.ros import NodeProcess

# Friction that explains what the arm holds itself with; at rest it adds nothing.
STICKY = ("-p", "coulomb_friction.joint_positive:=[1.,1.,1.,0.2,0.06,0.06,0.02]")
# Changes of the torque that are not to be compared with what the last start accepted.
TOLERANT = ("-p", "start_tolerance:=2.0")
AT_ONCE = ("-p", "ramp_time:=0.0", "-p", "slew_limit:=[0.,0.,0.,0.,0.,0.,0.]")
MODEL = TorqueModel.load(MODEL_FILE)


@pytest.fixture
def start(arm: FakeArm):
    """Start compensators that end with the test."""
    started: list[NodeProcess] = []

    def begin(*arguments: str, wait: bool = True, file: Path = MODEL_FILE) -> NodeProcess:
        node = NodeProcess("compensator", "--params-file", str(file), *arguments)
        started.append(node)
        if wait:
            output = "commands" if "output:=array" in arguments else "servo_jf"
            arm.await_compensator(output)
        return node

    yield begin
    for node in started:
        node.stop()
        assert "Traceback" not in node.output


def expected(arm: FakeArm) -> np.ndarray:
    return MODEL.torque(arm.position, arm.velocity)


def test_commands_the_model_s_torque_with_the_input_s_stamp_and_names(arm, start):
    start(*PATIENT, *AT_ONCE)
    effort = arm.answer()
    np.testing.assert_allclose(effort, expected(arm), atol=1e-12)
    assert list(arm.commands[-1][1].name) == list(JOINT_NAMES)


def test_joints_are_matched_by_name_in_any_order_and_extra_ones_ignored(arm, start):
    start(*PATIENT, *AT_ONCE)
    order = [6, 2, 0, 5, 1, 4, 3]
    effort = arm.answer(
        name=["gripper", *(arm.names[i] for i in order)],
        position=[9.0, *(arm.position[i] for i in order)],
        velocity=[9.0, *(arm.velocity[i] for i in order)],
        effort=[0.0] * 8,
    )
    # Answered in the order in which it measures: a console takes efforts by index.
    np.testing.assert_allclose(effort, expected(arm)[order], atol=1e-12)
    assert [arm.names[i] for i in order] in [list(message.name) for _, message in arm.commands]


BAD_MESSAGES = [
    ("missing_joint", {"name": ["a", *JOINT_NAMES[1:]]}),
    ("duplicate_joint", {"name": [JOINT_NAMES[0], *JOINT_NAMES[:6]]}),
    ("missing_joint", {"name": [], "position": [], "velocity": [], "effort": []}),
    ("wrong_length", {"position": [0.0] * 6}),
    ("wrong_length", {"velocity": [0.0] * 8}),
    ("wrong_length", {"position": []}),
    ("not_finite", {"position": [0.0] * 6 + [float("nan")]}),
    ("not_finite", {"position": [float("inf")] + [0.0] * 6}),
    ("not_finite", {"velocity": [0.0] * 6 + [float("-inf")]}),
    ("no_stamp", {"stamp": 0}),
    ("stamp_backwards", {"stamp": 500_000_000}),
]


def test_a_bad_message_gives_no_command_and_is_reported_and_counted_by_cause(arm, start):
    from diagnostic_msgs.msg import DiagnosticArray

    seen: list[dict[str, str]] = []
    arm.client.node.create_subscription(
        DiagnosticArray,
        "/diagnostics",
        lambda m: seen.append({item.key: item.value for item in m.status[0].values}),
        10,
    )
    node = start(*PATIENT, *AT_ONCE)
    assert arm.answer() is not None
    for cause, fields in BAD_MESSAGES:
        assert arm.answer(**fields) is None, (cause, fields)
    # The log is throttled: it names the first.
    arm.run_until(lambda: f"({BAD_MESSAGES[0][0]})" in node.output, "the cause in the log")
    causes = Counter(cause for cause, _ in BAD_MESSAGES)
    counts = {f"dropped {cause}": str(number) for cause, number in causes.items()}
    arm.run_until(lambda: bool(seen) and counts.items() <= seen[-1].items(), f"{counts}")
    arm.run_until(lambda: float(seen[-1]["input rate Hz"]) > 20, "the rate")
    last = seen[-1]
    assert last["state"] in ("ramping", "commanding")
    assert last["dropped position_jump"] == "0"
    assert last["saturated joints"] == "none"
    assert 0.0 < float(last["compute p50 us"]) <= float(last["compute p99 us"])
    assert float(last["input age s"]) < 1.0
    assert not arm.holds


def test_without_velocity_friction_is_off_and_that_is_said_once(arm, start):
    node = start(*PATIENT, *AT_ONCE)
    arm.velocity = [0.3] * 7  # below every allowance: faster, what was fed would come to count
    np.testing.assert_allclose(arm.answer(), expected(arm), atol=1e-12)
    bare = MODEL.torque(arm.position)
    assert np.abs(bare - expected(arm)).max() > 1e-3
    # Two messages within a fraction of a millisecond leave less way than that: see slew_limit.
    arm.run_until(lambda: np.abs(arm.efforts[-1] - bare).max() < 1e-12, "no friction", velocity=[])
    arm.answer(velocity=[])
    arm.client.wait(lambda: "has no velocity" in node.output, "the warning")
    assert node.output.count("has no velocity") == 1


def test_effort_stays_within_joint_and_actuator_limits(arm, start):
    start(*PATIENT, *AT_ONCE, *TOLERANT)
    arm.position[1] = 0.45
    arm.answer()
    joint, motor = [1, 1, 1, 1, 0.01, 1, 1], [1, 0.3, 0.2, 0.05, 1, 1, 1]
    values = {"effort_limit": [float(x) for x in joint], "actuator_effort_limit": motor}
    assert arm.client.set_parameters({k: [float(x) for x in v] for k, v in values.items()})[0]
    arm.run_until(lambda: arm.state.startswith("commanding"), "the end of the ramp")
    effort = arm.answer()
    coupling = MODEL.arm.actuator_to_joint
    unlimited = expected(arm)
    assert np.any(np.abs(unlimited @ coupling) > motor)
    assert abs(unlimited[4]) > 0.01
    assert np.all(np.abs(effort @ coupling) <= np.array(motor) + 1e-9)
    assert abs(effort[4]) <= 0.01 + 1e-9


def test_parameters_do_not_lift_the_arm_s_own_limits(arm, start):
    """A roll axis whose motor bears 0.023 N·m, and a model that asks for 0.2."""
    start(*PATIENT, *AT_ONCE, *TOLERANT, "-p", "effort_limit:=[10.,10.,10.,10.,10.,10.,10.]",
          "-p", "actuator_effort_limit:=[10.,10.,10.,10.,10.,10.,10.]")  # fmt: skip
    arm.answer()
    assert arm.client.set_parameters({"elastic_cable.wrist_roll": [0.2]})[0]
    arm.run_until(lambda: arm.state.startswith("commanding"), "the end of the ramp")
    effort = arm.answer()
    assert effort[6] == pytest.approx(0.023, abs=1e-9)
    changes = np.abs(np.diff(arm.efforts[:, 6]))
    assert changes.max() <= 0.023 / 0.02 * 0.02  # no slew limit: its greatest


def test_slew_limit_bounds_the_change_of_every_joint(arm, start):
    start(
        *PATIENT, *STICKY, "-p", "ramp_time:=0.0", "-p", "slew_limit:=[0.2,0.2,0.2,0.2,0.2,0.2,0.2]"
    )
    arm.effort = (expected(arm) - 0.05 * MODEL.arm.effort_limit).tolist()  # no need of a ramp
    arm.run_until(
        lambda: len(arm.commands) > 5 and np.allclose(arm.efforts[-1], expected(arm)), "arrival"
    )
    steps = np.abs(np.diff(arm.efforts, axis=0))
    assert steps.max() <= 0.2 * 0.02 + 1e-12  # never more than 20 ms of slew in a step
    assert steps[:, 1].max() > 0.0


def test_after_enabling_it_ramps_from_the_effort_that_holds_the_arm(arm, start):
    start(*PATIENT, *STICKY, "-p", "ramp_time:=0.4", "-p", "slew_limit:=[0.,0.,0.,0.,0.,0.,0.]")
    arm.effort = [0.1, -0.1, 0.05, 0.0, 0.01, 0.0, 0.0]
    arm.run_until(lambda: arm.state.startswith("commanding"), "the end of the ramp")
    assert "ramping: blending to the model's torque" in arm.client.states["compensator"]
    first, last = arm.efforts[0], arm.efforts[-1]
    np.testing.assert_allclose(first, arm.effort, atol=1e-12)
    arm.run(0.05)
    np.testing.assert_allclose(arm.efforts[-1], expected(arm), atol=1e-12)
    shoulder = arm.efforts[:, 1]
    assert np.all(np.diff(shoulder) >= -1e-12)  # all the way up, without a jump
    middle = (shoulder > -0.1 + 0.05) & (shoulder < last[1] - 0.05)
    assert middle.sum() > 3


def test_a_parameter_change_is_taken_and_never_makes_the_torque_jump(arm, start):
    start(*PATIENT, *TOLERANT, "-p", "ramp_time:=0.3", "-p", "slew_limit:=[0.,0.,0.,0.,0.,0.,0.]")
    arm.run_until(lambda: arm.state.startswith("commanding"), "commanding")
    arm.run(0.05)
    before = arm.efforts[-1]
    beta = [2.0 * value for value in MODEL.parameters()["beta"]]
    mark = len(arm.commands)
    taken, reason = arm.client.set_parameters({"beta": beta})
    assert taken, reason
    arm.run_until(lambda: len(arm.commands) > mark + 1, "commands")
    arm.run_until(lambda: arm.state.startswith("commanding"), "commanding again")
    arm.run(0.05)
    after = arm.efforts[-1]
    assert np.abs(after - before).max() > 0.1
    # The first command after the change lies on the ramp: nearer the old torque than the new.
    first = arm.efforts[mark]
    assert np.abs(first - before).max() < 0.5 * np.abs(after - before).max()
    changes = np.abs(np.diff(arm.efforts[mark:], axis=0)).max(axis=1)
    assert changes.max() < 0.5 * np.abs(after - before).max()


BAD_CHANGES = [
    ({"beta": [1.0] * 9}, "10 or 12 or 14"),
    ({"beta": [float("nan")] * 10}, "finite"),
    ({"effort_limit": [-1.0] * 7}, "effort_limit[0]"),
    ({"timeout": 1e9}, "timeout"),
    ({"timeout": 0.5, "ramp_time": -1.0}, "ramp_time"),
    ({"gravity_vector": [0.0, 0.0]}, "3 numbers"),
    ({"friction_compensation.ratio": [2.0] * 7}, "0 to 1"),
    ({"gravity_enabled": 3}, "true or false"),
    ({"arm": "mtml"}, "read-only"),
    ({"reading.effort_scale": [1.2] * 7}, "accept_reading_errors: true"),
]


def test_a_bad_parameter_change_is_refused_whole_with_the_reason(arm, start):
    start(*PATIENT, *AT_ONCE)
    before = arm.answer()
    for values, said in BAD_CHANGES:
        taken, reason = arm.client.set_parameters(values)
        assert not taken, values
        assert said in reason
        np.testing.assert_array_equal(arm.answer(), before)


def test_gravity_flag_off_leaves_the_other_terms(arm, start):
    start(*PATIENT, *AT_ONCE, "-p", "gravity_enabled:=false")
    cable = MODEL.term("directional_cable")
    only_cable = TorqueModel(MODEL.arm, (cable,)).torque(arm.position, arm.velocity)
    assert np.abs(only_cable).max() > 0.01
    np.testing.assert_allclose(arm.answer(), only_cable, atol=1e-12)


def test_gravity_flag_switches_at_run_time(arm, start):
    start(*PATIENT, *AT_ONCE)
    with_gravity = arm.answer()
    assert arm.client.set_parameters({"gravity_enabled": False})[0]
    arm.run_until(lambda: bool(arm.holds), "the hold, before it is measured again")
    arm.run_until(lambda: arm.state.startswith("commanding"), "the end of the ramp")
    without = arm.answer()
    gravity = MODEL.term("gravity")
    difference = TorqueModel(MODEL.arm, (gravity,)).torque(arm.position)
    np.testing.assert_allclose(with_gravity - without, difference, atol=1e-9)


def test_a_tilted_base_stays_tilted_when_a_parameter_changes(arm, start, tmp_path):
    """Gravity is the arm's own where the model file gives none."""
    upright = (CONFIG / "arms" / "mtmr.yaml").read_text()
    wall = tmp_path / "wall.yaml"
    wall.write_text(upright.replace("base_rpy: [0, 0, 0]", "base_rpy: [0, 90, 0]"))
    model = tmp_path / "model.yaml"
    lines = MODEL_FILE.read_text().replace("arm: mtmr", f"arm: {wall}").splitlines()
    model.write_text("\n".join(line for line in lines if "gravity_vector" not in line))
    wanted = TorqueModel.load(model).torque(arm.position, arm.velocity)
    assert np.abs(wanted - expected(arm)).max() > 0.1

    start(*PATIENT, *AT_ONCE, file=model)
    np.testing.assert_allclose(arm.answer(), wanted, atol=1e-12)
    assert arm.client.set_parameters({"max_stamp_age": 0.0})[0]
    np.testing.assert_allclose(arm.answer(), wanted, atol=1e-12)


def test_enable_false_ends_in_a_hold_and_true_starts_again(arm, start):
    start(*PATIENT, *AT_ONCE)
    arm.answer()
    response = arm.client.enable(False)
    assert response.success
    assert "disabled" in response.message
    arm.client.wait(lambda: bool(arm.holds), "the hold")
    mark = len(arm.commands)
    arm.run(0.2)
    assert len(arm.commands) == mark
    assert arm.state.startswith("disabled")
    assert arm.client.enable(True).success
    arm.run_until(lambda: len(arm.commands) > mark, "commands")


def test_started_disabled_it_commands_nothing_and_holds_nothing(arm, start):
    start(*PATIENT, "-p", "enabled:=false")
    arm.run(0.3)
    assert not arm.commands
    assert not arm.holds
    assert arm.client.set_parameters({"enabled": True})[0]
    arm.run_until(lambda: len(arm.commands) > 0, "commands")


def test_when_input_stops_it_holds_in_time_and_resumes_only_when_told(arm, start):
    start(*PATIENT)
    arm.run_until(lambda: len(arm.commands) > 10, "commands")
    silence = time.monotonic()
    arm.client.wait(lambda: bool(arm.holds), "the hold")
    assert 0.6 * TIMEOUT < arm.holds[0] - silence < TIMEOUT + 0.7
    arm.client.wait(lambda: arm.state.startswith("fault: no valid measured_js"), "the reason")
    mark = len(arm.commands)
    arm.run(0.5)
    assert len(arm.commands) == mark
    assert arm.client.enable(True).success
    arm.run_until(lambda: len(arm.commands) > mark, "commands")


def test_invalid_input_does_not_count_as_fresh(arm, start):
    start(*PATIENT)
    arm.run_until(lambda: len(arm.commands) > 10, "commands")
    arm.run_until(lambda: bool(arm.holds), "the hold", position=[float("nan")] * 7)
    arm.client.wait(lambda: arm.state.startswith("fault"), "the fault")


def test_a_stamp_that_stands_still_is_stale_input(arm, start):
    start(*PATIENT)
    arm.run_until(lambda: len(arm.commands) > 10, "commands")
    arm.run_until(lambda: bool(arm.holds), "the hold", stamp=arm.stamp)
    arm.client.wait(lambda: "stamp" in arm.state, "the reason")


def test_automatic_resume_goes_on_by_itself(arm, start):
    start(*PATIENT, "-p", "resume:=automatic")
    arm.run_until(lambda: len(arm.commands) > 10, "commands")
    arm.client.wait(lambda: bool(arm.holds), "the hold")
    mark = len(arm.commands)
    arm.run_until(lambda: len(arm.commands) > mark, "commands")


def test_an_internal_error_holds_says_why_and_needs_to_be_enabled_again(arm, start):
    # A polynomial that overflows from 1.35 rad on.
    start(*PATIENT, *AT_ONCE, "-p", "elastic_cable.wrist_roll:=[0.0, 0.0, 1.0e+308]")
    arm.position[6] = 0.0
    arm.answer()
    arm.go([*arm.position[:6], 1.5])
    arm.run_until(lambda: bool(arm.holds), "the hold")
    arm.client.wait(lambda: arm.state.startswith("fault"), "the reason")
    assert "wrist_roll" in arm.state
    assert "not a finite number" in arm.state
    mark = len(arm.commands)
    arm.run(0.2)
    assert len(arm.commands) == mark
    arm.go([*arm.position[:6], 0.0])
    arm.client.enable(True)
    arm.run_until(lambda: len(arm.commands) > mark, "commands")


def test_refuses_while_the_arm_s_own_compensation_is_on_and_says_how_to_switch_it_off(arm, start):
    start(*PATIENT)
    on, off = [0.0, 0.3, 0.1, 0.0, 0.0, 0.0, 0.0], [0.0] * 7
    arm.builtin.publish(arm.message(effort=on))
    arm.client.wait(lambda: "use_gravity_compensation" in arm.state, "the refusal")
    arm.run(0.2)
    assert not arm.commands
    assert not arm.switches  # it says so, but leaves the arm's settings alone
    arm.builtin.publish(arm.message(effort=off))
    arm.run_until(lambda: len(arm.commands) > 0, "commands")
    arm.builtin.publish(arm.message(effort=on))
    arm.run_until(lambda: bool(arm.holds), "the hold")
    arm.client.wait(lambda: arm.state.startswith("fault"), "the fault")


def test_switches_the_arm_s_own_compensation_off_if_it_may_and_goes_on(arm, start):
    start(*PATIENT, "-p", "disable_builtin:=true")
    on, off = [0.0, 0.3, 0.1, 0.0, 0.0, 0.0, 0.0], [0.0] * 7
    arm.builtin.publish(arm.message(effort=on))
    arm.client.wait(lambda: arm.switches == [False], "the switch")
    assert not arm.commands
    arm.builtin.publish(arm.message(effort=off))
    arm.run_until(lambda: len(arm.commands) > 0, "commands")
    arm.builtin.publish(arm.message(effort=on))  # teleoperation switches it on again
    arm.run_until(lambda: bool(arm.holds), "the hold")
    arm.run_until(lambda: len(arm.switches) == 2, "the switch")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_ends_it_with_a_hold_and_status_0(arm, start, number):
    node = start(*PATIENT)
    arm.run_until(lambda: len(arm.commands) > 5, "commands")
    node.signal(number)
    arm.client.wait(lambda: bool(arm.holds), "the hold")
    assert node.wait() == 0
    after = [when for when, _ in arm.commands if when > arm.holds[0]]
    assert not after


def test_a_signal_while_another_one_is_handled_ends_a_node_as_well():
    """As where a launcher ends it and is killed: handlers that wait for a lock wait for ever."""
    script = """
import signal
import sys
from dvrk_gravity.ros import runtime
def interrupt(frame, event, argument):
    if event == "line":
        signal.raise_signal(signal.SIGTERM)
    return interrupt
def run(*of_spin):
    sys.settrace(interrupt)
    signal.raise_signal(signal.SIGTERM)
    sys.settrace(None)
    return 0
runtime._run = run
sys.exit(runtime.spin(None, []))
"""
    done = subprocess.run([sys.executable, "-c", script], timeout=20.0, check=False)
    assert done.returncode == 0


def test_an_unexpected_exception_ends_it_with_a_hold_and_status_1(arm):
    broken = """
import sys
from dvrk_gravity.__main__ import main
from dvrk_gravity.compensate.settings import Settings
whole = Settings.parts
def parts(self, q, qd):
    if qd is not None and qd[6] > 1.0:
        raise RuntimeError("a defect")
    return whole(self, q, qd)
Settings.parts = parts
sys.exit(main())
"""
    with NodeProcess(
        "compensator", "--params-file", str(MODEL_FILE), *PATIENT, program=("-c", broken)
    ) as node:
        arm.await_compensator()
        arm.run_until(lambda: len(arm.commands) > 0, "commands")
        assert not arm.holds
        arm.run_until(lambda: bool(arm.holds), "the hold", velocity=[0.0] * 6 + [2.0])
        assert node.wait() == 1
        assert "a defect" in node.output


def test_output_as_an_array_for_ros2_control(arm, start):
    from std_msgs.msg import Float64MultiArray

    received: list[np.ndarray] = []
    arm.client.node.create_subscription(
        Float64MultiArray, "effort_controller/commands", lambda m: received.append(m.data), 10
    )
    start(*PATIENT, *AT_ONCE, "-p", "output:=array",
          "-p", "output_topic:=effort_controller/commands", wait=False)  # fmt: skip
    arm.run_until(lambda: len(received) > 0, "an array")
    np.testing.assert_allclose(received[-1], expected(arm), atol=1e-12)
    assert not arm.commands


def test_a_stamp_far_from_the_node_s_clock_gives_no_command(arm, start):
    node = start(*PATIENT, *AT_ONCE)
    for shift, cause in ((-5_000_000_000, "stamp_too_old"), (3_600_000_000_000, "stamp_ahead")):
        arm.shift = shift
        arm.run_until(lambda cause=cause: f"({cause})" in node.output, "the cause")
        assert not arm.commands
    arm.shift = 0
    assert arm.answer() is not None


def test_clocks_of_two_computers_may_differ_where_that_is_said(arm, start):
    start(*PATIENT, *AT_ONCE, "-p", "max_stamp_age:=0.0")
    arm.shift = -5_000_000_000
    assert arm.answer() is not None


def test_each_parameter_describes_itself_and_unused_effects_are_not_declared(arm, start):
    from rcl_interfaces.srv import DescribeParameters, ListParameters

    start(*PATIENT)
    names = arm.client.call(ListParameters, "compensator/list_parameters").result.names
    assert {"beta", "ramp_time", "directional_cable.positive.elbow_pitch"} <= set(names)
    assert not [name for name in names if name.startswith(("cogging", "link_inertia", "contact"))]
    request = DescribeParameters.Request(names=["ramp_time", "beta", "arm"])
    ramp, beta, which = arm.client.call(
        DescribeParameters, "compensator/describe_parameters", request
    ).descriptors
    assert ramp.name == "ramp_time"
    assert "to the model's" in ramp.description
    assert ramp.description.endswith("(double, s)")
    assert (ramp.floating_point_range[0].from_value, ramp.floating_point_range[0].to_value) == (
        0.0,
        60.0,
    )
    assert "gravity base parameters" in beta.description
    assert which.read_only
    # An effect that the model does not have may still be given while the node runs.
    assert arm.client.set_parameters({"payload.mass": 0.1})[0]
    taken, reason = arm.client.set_parameters({"payload.mas": 0.1})
    assert not taken
    assert "payload.mass" in reason
