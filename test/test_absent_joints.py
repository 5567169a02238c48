"""Recordings without some of the arm's joints, and what they still determine, on small arrays."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from made_up_arm import made_up_arm, write

from dvrk_gravity.arms import Arm
from dvrk_gravity.errors import ArgumentError, RecordingError
from dvrk_gravity.observation import (
    completed,
    held_beyond,
    known_fixed_positions,
    motors_measured,
    observe,
    require_all,
    require_measured,
    stands,
    with_held,
    without_standing,
)
from dvrk_gravity.recording import Recording

MTM = Arm.load("mtmr")


@pytest.fixture
def arm(tmp_path) -> Arm:
    """A chain R-R-P-R whose third motor moves with the second."""
    return made_up_arm(tmp_path)


def recorded(joints, samples=5, **changes) -> Recording:
    """Return a recording of some joints, every number different."""
    values = np.arange(1.0, 1.0 + samples * len(joints)).reshape(samples, -1) / 1000.0
    fields = {"velocity": values, "effort": values, "source": "some.csv"} | changes
    return Recording(joints, fields.pop("time", np.arange(samples) / 100.0), values, **fields)


@pytest.mark.parametrize("coordinates", ["joint", "actuator"])
def test_the_motors_of_joints_that_stand_follow_the_recorded_ones(arm, coordinates):
    q = np.array([[0.3, -0.2, 0.1, 0.5], [0.1, 0.4, 0.1, -0.7]])
    given = q if coordinates == "joint" else arm.actuator_position(q)
    still = np.array([9.0, 9.0, 0.1, 9.0])  # of joints that were recorded, it is not looked at
    found = completed(given[:, [0, 1, 3]], [0, 1, 3], still, arm, coordinates)
    np.testing.assert_allclose(found, given, atol=1e-12)


def test_a_motor_is_measured_where_all_joints_that_load_it_are():
    """tau_actuator = M^T tau_joint; joints of an MTM's shoulder and elbow share motors."""
    shared = MTM.actuator_to_joint != 0.0
    for missing in range(MTM.n):
        columns = [joint for joint in range(MTM.n) if joint != missing]
        joint = motors_measured(columns, MTM, "joint")
        assert joint.tolist() == (~shared[missing]).tolist()
        own = motors_measured(columns, MTM, "actuator")
        assert own.tolist() == [motor != missing for motor in range(MTM.n)]


def test_joints_beyond_all_recorded_ones_are_held_at_zero_or_the_nearest_limit(arm, tmp_path):
    bare = Arm.load(write(tmp_path, {"followers": []}))
    first, most = recorded(("yaw", "pitch")), recorded(("yaw", "pitch", "insertion"))
    for of, given, still, expected in (
        (bare, first, {}, {"insertion": 0.02, "roll": 0.0}),
        (bare, first, {"roll": 1.0}, {"insertion": 0.02, "roll": 1.0}),
        (arm, most, {}, {"roll": 0.0}),
        (arm, first, {}, {}),  # not beyond: with the insertion goes a counterweight
        (arm, recorded(("yaw", "roll")), {}, {}),
        (arm, recorded(arm.joint_names), {}, {}),
        (MTM, recorded(MTM.joint_names[:5]), {}, {}),  # there, it is a mistake
    ):
        found, lines = held_beyond([given], of, still)
        assert found == expected
        assert len(lines) == (len(expected) > len(still))


def test_what_is_held_is_no_part_of_the_arm_that_is_fitted(arm):
    given = recorded(("yaw", "pitch", "insertion"))
    shorter, (recording,), lines = with_held([given], arm, {})
    assert shorter.joint_names == ("yaw", "pitch", "insertion")
    assert recording.joints == shorter.joint_names
    assert len(lines) == 1
    for still, joints in (({"roll": 0.3}, 3), ({"yaw": 0.3}, 4)):
        kept, _, _ = with_held([recorded(tuple(set(arm.joint_names) - set(still)))], arm, still)
        assert kept.n == joints  # what carries recorded joints stays, where it stood
    ecm = Arm.load("ecm")  # but where motors are the joints', recorded there or not
    for seen, at in ((ecm.joint_names[1:], 0.5), (ecm.joint_names, 0.01)):
        assert with_held([recorded(seen)], ecm, {ecm.joint_names[0]: at})[0].n == ecm.n - 1
    assert with_held([recorded(ecm.joint_names)], ecm, {ecm.joint_names[0]: 0.5})[0] is ecm
    same, recordings, lines = with_held([recorded(arm.joint_names)], arm, {})
    assert (same is arm, len(recordings), lines) == (True, 1, ())


def test_positions_of_joints_that_stood_are_numbers_of_known_joints(arm):
    assert known_fixed_positions(None, arm) == {}
    assert known_fixed_positions({"yaw": 0.5}, arm) == {"yaw": 0.5}
    for still in ([0.1], {"elbow": 0.1}, {"yaw": "left"}, {"yaw": float("nan")}):
        with pytest.raises(ArgumentError, match="still"):
            known_fixed_positions(still, arm)


def test_a_recording_without_a_joint_or_efforts_is_refused_by_name(arm):
    require_all(recorded(arm.joint_names), arm)
    require_all(recorded(arm.joint_names[1:]), arm, {"yaw": 0.1})
    for recording, tokens in (
        (recorded(arm.joint_names[1:]), "some.csv: has no yaw"),
        (recorded(arm.joint_names, effort=None), "some.csv: has no efforts"),
    ):
        with pytest.raises(RecordingError, match=tokens):
            require_all(recording, arm)
    with pytest.raises(RecordingError, match="--at insertion=0mm"):
        require_all(recorded(("yaw", "pitch")), arm, {})
    with pytest.raises(RecordingError, match="--at yaw=0deg"):
        require_all(recorded(("insertion", "roll")), arm, {})


def test_efforts_that_are_the_same_all_the_time_are_not_measured():
    effort = np.array([[1.0, 2.0], [3.0, 2.0], [2.0, 2.0 + 1e-10]])
    require_measured("a.csv", ("yaw",), effort[:, :1])
    with pytest.raises(RecordingError, match=r"a\.csv: .* pitch .*\(2\)"):
        require_measured("a.csv", ("yaw", "pitch"), effort)
    with pytest.raises(RecordingError, match="zero"):
        require_measured("a.csv", ("yaw",), 0.0 * effort[:, :1])


def swing(arm: Arm, still=(), rate=100.0, seconds=12.0) -> Recording:
    """Return a motion of an arm in the middle of its range, some joints of which stand."""
    time = np.arange(0.0, seconds, 1.0 / rate)
    lower, upper = arm.range
    omega, size = 2.0 * np.pi * (0.3 + 0.1 * np.arange(arm.n)), 0.3 * (upper - lower)
    size = np.where(np.isin(arm.joint_names, still), 0.0, size)
    angle = np.outer(time, omega)
    q, qd = 0.5 * (lower + upper) + size * np.sin(angle), size * omega * np.cos(angle)
    effort = np.sin(angle + 1.0) * np.arange(1.0, arm.n + 1.0)
    return Recording(arm.joint_names, time, q, qd, effort, source="swing.csv")


def test_a_motion_is_read_at_the_joints_and_its_torque_at_the_motors():
    motion = swing(MTM)
    (part,) = observe([motion], MTM)
    inner = slice(part.filter.edge, -part.filter.edge)
    rows = np.searchsorted(motion.time, part.time[inner] - 1e-6)
    np.testing.assert_allclose(part.q[inner], motion.position[rows], atol=4e-3)
    torque = motion.effort[rows] @ MTM.actuator_to_joint
    np.testing.assert_allclose(part.motor_effort(MTM)[inner], torque, rtol=0.01, atol=0.02)
    motors = replace(
        motion,
        position=MTM.actuator_position(motion.position),
        velocity=MTM.actuator_position(motion.velocity),
        effort=MTM.actuator_effort(motion.effort),
        coordinates="actuator",
    )
    (same,) = observe([motors], MTM)
    np.testing.assert_allclose(same.q, part.q, atol=1e-9)
    np.testing.assert_allclose(same.effort, part.effort, atol=1e-9)


def test_recordings_of_several_rates_are_read_at_the_lowest():
    slow, fast = observe([swing(MTM, rate=50.0), swing(MTM, rate=80.0)], MTM)
    assert slow.filter.rate == fast.filter.rate == pytest.approx(50.0, rel=1e-3)
    np.testing.assert_allclose(np.diff(fast.time), 0.02, rtol=1e-3)
    both = slice(40, 400)
    np.testing.assert_allclose(fast.q[both], slow.q[both], atol=4e-3)


def test_a_joint_that_stands_and_the_motors_that_hold_it_are_not_fitted_to():
    motion = swing(MTM, still=("elbow_pitch",))
    parts, names = without_standing(observe([motion], MTM), MTM)
    assert names == ("elbow_pitch",)
    loaded = MTM.actuator_to_joint[2] != 0.0
    assert parts[0].invalid_motor_effort.all(axis=0).tolist() == loaded.tolist()
    ranges = np.full(MTM.n, 0.1)
    ranges[[1, 2]] = 0.019, 0.021
    assert stands(-ranges / 2, ranges / 2, MTM).tolist() == [False, True] + 5 * [False]


LINK = '<link name="{}"/>'
JOINT = (
    '<joint name="{}" type="revolute"><parent link="{}"/><child link="{}"/><axis xyz="0 0 1"/>'
    '<limit lower="-1" upper="2" effort="3" velocity="4"/></joint>'
)


@pytest.mark.parametrize(
    ("names", "ends"),
    [
        (("left_1", "left_2"), ["e"]),
        (("torso", "left_1", "left_2", "right_1"), ["e", "f"]),
        (("wheel",), ["b"]),
        (("somebody_elses",), []),
    ],
)
def test_of_a_robot_with_branches_the_parts_that_were_recorded_are_named(names, ends, tmp_path):
    joints = ("wheel ab", "torso ac", "left_1 cd", "left_2 de", "right_1 cf", "right_2 fg")
    text = "".join(map(LINK.format, "abcdefg"))
    text += "".join(JOINT.format(name, *links) for name, links in map(str.split, joints))
    (tmp_path / "robot.urdf").write_text(f'<robot name="r">{text}</robot>')
    robot = Arm.load(tmp_path / "robot.urdf")
    with pytest.raises(RecordingError) as caught:
        require_all(recorded(names), robot, {})
    parts = [f"{robot.source}#{end}" for end in ends]
    assert str(caught.value).endswith(f"--arm {' or '.join(parts)}") == bool(ends)
    for part in parts:
        assert set(names) & set(Arm.load(part).joint_names)
