"""The compensator as a process of its own, over DDS: messages, parameters, services."""

from __future__ import annotations

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.srv import DescribeParameters, ListParameters
from rclpy.qos import QoSProfile, ReliabilityPolicy
from running import AT_ONCE, MODEL, answers_since, assert_silent, commanding, expected, faulty, held
from std_msgs.msg import Float64MultiArray
from support import CONFIG

from dvrk_gravity.arms import JOINT_NAMES
from dvrk_gravity.compensate import Settings
from dvrk_gravity.ros import PRIVATE


def test_a_measurement_is_answered_with_the_model_s_torque_in_its_order_of_joints(arm, start):
    start("compensator", *AT_ONCE)
    arm.velocity = [0.3] * 7  # below every allowance: faster, what was fed would come to count
    np.testing.assert_allclose(arm.answer(), expected(arm), atol=1e-12)
    order = [6, 2, 0, 5, 1, 4, 3]
    effort = arm.answer(
        name=[*(arm.names[i] for i in order), "gripper"],
        position=[*(arm.position[i] for i in order), 9.0],
        velocity=[*(arm.velocity[i] for i in order), 9.0],
        effort=[0.0] * 8,
    )
    np.testing.assert_allclose(effort, expected(arm)[order], atol=1e-12)
    answered = [list(message.name) for _, message in arm.commands]
    assert list(JOINT_NAMES) in answered
    assert [arm.names[i] for i in order] in answered
    # Without velocity there is no friction; two messages within a moment leave less way than that.
    bare = MODEL.torque(arm.position)
    assert np.abs(bare - expected(arm)).max() > 1e-3
    arm.run_until(lambda: np.abs(arm.efforts[-1] - bare).max() < 1e-12, "no friction", velocity=[])
    # Before the arm's joints, a gripper shifts what a console takes by index.
    mark, first = arm.stamp, {"name": ["gripper", *arm.names], "effort": [0.0] * 8}
    first |= {"position": [0.0, *arm.position], "velocity": []}
    tokens = (f"gripper,{','.join(arm.names)}", "command_joints")
    arm.run_until(lambda: bool(arm.holds) and all(t in arm.state for t in tokens), "hold", **first)
    assert answers_since(arm, mark) == 0
    faulty(arm, "command_joints")


BAD_MESSAGES = [
    ("missing_joint", {"name": ["a", *JOINT_NAMES[1:]]}),
    ("wrong_length", {"velocity": [0.0] * 8}),
    ("not_finite", {"position": [0.0] * 6 + [float("nan")]}),
    ("no_stamp", {"stamp": 0}),
    ("stamp_backwards", {"stamp": 500_000_000}),
    ("out_of_range", {"position": [30.0] + [0.0] * 6}),
]


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_a_bad_message_gives_no_command_and_is_counted_by_cause_in_diagnostics(arm, start):
    seen: list[dict[str, str]] = []

    def see(message: DiagnosticArray) -> None:
        seen.append({item.key: item.value for item in message.status[0].values})

    arm.client.node.create_subscription(DiagnosticArray, "/diagnostics", see, 10)
    start("compensator", *AT_ONCE)
    assert arm.answer() is not None
    for cause, fields in BAD_MESSAGES:
        assert arm.answer(**fields) is None, cause
    for data in (b"\0\1\0\0", b"\xff" * 4096):
        arm.measured.publish(data)
        assert arm.answer() is not None
    counts = {f"dropped {cause}": "1" for cause, _ in BAD_MESSAGES} | {"dropped malformed": "2"}
    arm.run_until(lambda: bool(seen) and counts.items() <= seen[-1].items(), f"{counts}")
    assert seen[-1]["saturated joints"] == "none"
    assert 0.0 < float(seen[-1]["compute p50 us"]) <= float(seen[-1]["compute p99 us"])
    assert not arm.holds
    wrong = [0.0, 3.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    arm.run_until(lambda: "fault" in arm.state, "a fault", velocity=wrong)
    assert "shoulder_pitch" in arm.state


# --- parameters ------------------------------------------------------------------------------


def test_parameters_describe_themselves_and_a_change_is_ramped_or_measured_anew(arm, start):
    arm.effort = MODEL.torque(arm.position).tolist()
    start("compensator", "-p", "ramp_time:=0.3")
    names = arm.client.call(ListParameters, "compensator/list_parameters").result.names
    assert {"beta", "ramp_time", "directional_cable.positive.elbow_pitch"} <= set(names)
    assert not [name for name in names if name.startswith(("cogging", "link_inertia", "contact"))]
    asked = DescribeParameters.Request(names=["ramp_time", "arm"])
    told = arm.client.call(DescribeParameters, "compensator/describe_parameters", asked)
    ramp, which = told.descriptors
    assert ramp.floating_point_range[0].to_value == 60.0
    assert which.read_only
    commanding(arm)
    # An effect that the model does not have may still be given while the node runs.
    assert arm.client.set_parameters({"payload.mass": 0.05})[0]
    loaded = Settings.from_parameters(MODEL.parameters() | {"payload.mass": 0.05})
    torque = loaded.static_torque(np.array(arm.position))
    assert np.abs(torque - expected(arm)).max() > 0.05
    arm.run_until(lambda: np.abs(arm.efforts[-1] - torque).max() < 1e-9, "the load's torque")
    assert not arm.holds
    # More than a start accepts: the arm is held, and what is measured speaks against it.
    mark = arm.stamp
    assert arm.client.set_parameters({"payload.mass": 0.4})[0]
    held(arm)
    faulty(arm)
    np.testing.assert_allclose(arm.efforts[-1], torque, atol=1e-9)
    assert answers_since(arm, mark) < 100


BAD_CHANGES = [
    ({"beta": [1.0] * 9}, "beta"),
    ({"effort_limit": [-1.0] * 7}, "effort_limit[0]"),
    ({"timeout": 0.5, "ramp_time": -1.0}, "ramp_time"),
    ({"gravity_enabled": 3}, "gravity_enabled"),
    ({"arm": "mtml"}, "arm"),
    ({"payload.mas": 0.1}, "payload.mass"),
    ({"reading.effort_scale": [1.2] * 7}, "accept_reading_errors"),
]
NAN, INF = float("nan"), float("inf")
NONSENSE = [NAN, -INF, 1e300, -(2**63), "x" * 5000, [NAN] * 7, [-1.0] * 7, ["a"] * 7]
NAMES = ["effort_limit", "enabled"]


def test_a_bad_change_is_refused_whole_and_nonsense_changes_nothing(arm, start):
    start("compensator", *AT_ONCE)
    before = arm.answer()
    for values, token in BAD_CHANGES:
        taken, reason = arm.client.set_parameters(values)
        assert not taken, values
        assert token in reason
        np.testing.assert_array_equal(arm.answer(), before)
    for name in NAMES:
        for value in NONSENSE:
            taken, reason = arm.client.set_parameters({name: value})
            assert not taken, (name, value)
            arm.send()
    np.testing.assert_array_equal(arm.answer(), before)


def test_stopping_is_never_refused_whatever_stands_beside_it_or_became_of_files(
    arm, start, tmp_path
):
    description = tmp_path / "arm.yaml"
    description.write_bytes((CONFIG / "arms" / "mtmr.yaml").read_bytes())
    start("compensator", "-p", f"arm:={description}")
    commanding(arm)
    for beside in ({"beta": [1.0] * 9}, {"arm": "mtml"}):
        arm.holds.clear()
        assert not arm.client.set_parameters({"enabled": False, **beside})[0]
        held(arm)
        assert_silent(arm)
        assert arm.state.startswith("disabled")
        assert arm.client.enable(True).success
        commanding(arm)
    description.rename(tmp_path / "elsewhere.yaml")
    arm.holds.clear()
    assert arm.client.enable(False).success
    held(arm)
    assert_silent(arm)
    assert arm.state.startswith("disabled")
    assert arm.client.enable(True).success
    commanding(arm)


# --- topics ----------------------------------------------------------------------------------


def test_the_arm_s_own_compensation_is_switched_off_if_that_is_allowed(arm, start):
    start("compensator", "-p", "disable_builtin:=true")
    on, off = [0.0, 0.3, 0.1, 0.0, 0.0, 0.0, 0.0], [0.0] * 7
    arm.builtin.publish(arm.message(effort=on))
    # Not before others have been heard, and again while it stays on.
    arm.run_until(lambda: "use_gravity_compensation" in arm.state, "the reason")
    while not arm.switches:
        arm.builtin.publish(arm.message(effort=on))
        arm.run(0.05)
    assert not any(arm.switches)
    assert not arm.commands
    arm.builtin.publish(arm.message(effort=off))
    commanding(arm)
    arm.switches.clear()
    arm.builtin.publish(arm.message(effort=on))  # teleoperation switches it on again
    held(arm)
    arm.run_until(lambda: arm.switches == [False], "the switch")


def test_an_array_for_ros2_control_and_a_rival_that_its_controller_would_obey(arm, start):
    """Controllers subscribe with the middleware's defaults: DDS's best effort."""
    profile = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
    node = arm.client.node
    rival = node.create_publisher(Float64MultiArray, "commands", profile)
    obeyed = arm.takes_array(arm.names[::-1])
    stated = f"command_joints:={','.join(arm.names[::-1])}"
    start("compensator", *AT_ONCE, "-p", "output:=array", "-p", stated)
    arm.run_until(lambda: len(obeyed) > 20, "commands beside an idle client")
    np.testing.assert_allclose(obeyed[-1].data[::-1], expected(arm), atol=1e-12)
    assert not arm.commands
    assert not arm.holds
    while not arm.holds:
        rival.publish(Float64MultiArray())
        arm.run(0.01)
    faulty(arm, f"{PRIVATE}/commands")


def test_a_controller_of_another_order_of_joints_is_sent_nothing(arm, start):
    obeyed = arm.takes_array(arm.names[::-1])
    start("compensator", *AT_ONCE, "-p", "output:=array")
    both = (",".join(arm.names), f"command_joints:={','.join(arm.names[::-1])}")
    arm.run_until(lambda: all(token in arm.state for token in both), "the refusal")
    arm.run(0.5)
    assert not obeyed
