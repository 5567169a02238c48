"""The arms that are shipped, their transmission, and what is wrong with an arm's file."""

from __future__ import annotations

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation
from support import CONFIG

from dvrk_gravity.arms import JOINT_NAMES, Arm, gravity_in_base
from dvrk_gravity.errors import ConfigError
from testing.mujoco_arms import dh_table

DH = (  # alpha, a, d, offset [deg, m]
    (90, 0.0, 0.0, -90),
    (0, 0.2794, 0.0, -90),
    (-90, 0.3645, 0.0, 90),
    (90, 0.0, 0.1506, 0),
    (-90, 0.0, 0.0, 0),
    (90, 0.0, 0.0, -90),
    (0, 0.0, 0.0, 90),
)
LOWER = {
    "mtml": [-40, -15, -50, -205, -95, -45, -480],
    "mtmr": [-65, -18, -50, -95, -95, -45, -480],
}
UPPER = {"mtml": [65, 65, 35, 95, 185, 45, 450], "mtmr": [40, 65, 35, 205, 185, 45, 450]}


@pytest.fixture(params=["mtml", "mtmr"])
def arm(request) -> Arm:
    return Arm.load(request.param)


def test_shipped_arms_have_the_published_geometry_and_limits(arm):
    assert arm.joint_names == JOINT_NAMES
    table = [(joint.alpha, joint.a, joint.d, joint.offset) for joint in dh_table(arm.name)]
    expected = [(np.radians(alpha), a, d, np.radians(offset)) for alpha, a, d, offset in DH]
    np.testing.assert_allclose(table, expected, atol=1e-15)
    np.testing.assert_allclose(np.degrees(arm.lower), LOWER[arm.name])
    np.testing.assert_allclose(np.degrees(arm.upper), UPPER[arm.name])
    np.testing.assert_array_equal(
        arm.actuator_effort_limit, [1.861, 1.464, 1.753, 0.309, 0.097, 0.097, 0.023]
    )
    np.testing.assert_array_equal(
        arm.effort_limit, [1.861, 3.217, 1.96, 0.309, 0.097, 0.097, 0.023]
    )
    assert arm.body("crank").frame.translation @ arm.body("crank").frame.translation == 0.1**2
    np.testing.assert_allclose(arm.gravity, [0, 0, -9.81])


def test_left_and_right_arm_mirror_their_ranges_of_the_first_and_fourth_joint():
    left, right = Arm.load("mtml"), Arm.load("mtmr")
    for joint in (0, 3):
        assert left.lower[joint] == -right.upper[joint]
        assert left.upper[joint] == -right.lower[joint]


def test_motors_of_shoulder_elbow_and_platform_are_coupled_as_published(arm):
    motor = np.random.default_rng(0).uniform(-2, 2, (50, 7))
    joint = motor.copy()
    joint[:, 2] = motor[:, 2] - motor[:, 1]
    joint[:, 3] = motor[:, 3] + 0.6697 * (motor[:, 1] - motor[:, 2])
    np.testing.assert_allclose(arm.joint_position(motor), joint, atol=1e-14)
    np.testing.assert_allclose(arm.actuator_position(joint), motor, atol=1e-14)
    # Hence the elbow's motor turns with q2 + q3.
    np.testing.assert_allclose(motor[:, 2], joint[:, 1] + joint[:, 2], atol=1e-14)


def test_power_is_the_same_at_joints_and_motors(arm):
    rng = np.random.default_rng(1)
    motor_velocity, motor_effort = rng.normal(size=(2, 50, 7))
    joint_velocity = arm.joint_position(motor_velocity)
    joint_effort = arm.joint_effort(motor_effort)
    np.testing.assert_allclose(
        np.sum(joint_velocity * joint_effort, axis=1),
        np.sum(motor_velocity * motor_effort, axis=1),
        atol=1e-13,
    )
    np.testing.assert_allclose(arm.actuator_effort(joint_effort), motor_effort, atol=1e-14)


def test_gravity_in_a_tilted_base_is_the_world_s_turned_into_it():
    for rpy in np.random.default_rng(2).uniform(-np.pi, np.pi, (50, 3)):
        world_from_base = Rotation.from_euler("ZYX", rpy[::-1])
        expected = world_from_base.inv().apply([0, 0, -9.81])
        np.testing.assert_allclose(gravity_in_base(*rpy), expected, atol=1e-14)


def test_an_arm_s_file_tilts_its_gravity(tmp_path):
    content = yaml.safe_load((CONFIG / "arms" / "mtmr.yaml").read_text())
    content["base_rpy"] = [0, 90, 45]  # degrees: the base's x axis points down
    file = tmp_path / "tilted.yaml"
    file.write_text(yaml.safe_dump(content))
    np.testing.assert_allclose(Arm.load(file).gravity, [9.81, 0, 0], atol=1e-14)


def test_constants_of_an_arm_cannot_be_written(arm):
    for array in (arm.actuator_to_joint, arm.actuator_effort_limit):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0.0


MISSING = object()
WRONG = {
    "unknown field": (("colour",), "red", "colour: got 'colour'"),
    "missing field": (("parallelogram",), MISSING, "parallelogram: got nothing"),
    "name": (("name",), 7, "name: got 7"),
    "six joints": (("joints",), [], "joints: got []"),
    "joints not a list": (("joints",), "seven", "joints: got 'seven'"),
    "joint not a mapping": (("joints", 2), 5, "joints[2]: got 5"),
    "joint twice": (("joints", 2, "name"), "wrist_yaw", "joints[5].name: got 'wrist_yaw'"),
    "joint of another arm": (("joints", 2, "name"), "elbow", "joints.elbow_pitch: got"),
    "joint of another kind": (("joints", 2, "type"), "prismatic", "joints.elbow_pitch: got"),
    "angle of another arm": (("joints", 3, "alpha"), 80, "joints.wrist_platform: got 'alpha 80"),
    "joint's field unknown": (("joints", 4, "mass"), 1.0, "joints.wrist_pitch: got ['mass']"),
    "joint's field missing": (("joints", 4, "a"), MISSING, "joints.wrist_pitch: got ['a']"),
    "length as text": (("joints", 1, "a"), "long", "joints.shoulder_pitch.a: got 'long'"),
    "length as truth": (("joints", 1, "a"), True, "joints.shoulder_pitch.a: got True"),
    "length not finite": (("joints", 1, "a"), float("nan"), "joints.shoulder_pitch.a: got nan"),
    "length beyond floats": (("joints", 1, "a"), 10**400, "joints.shoulder_pitch.a: got 1000"),
    "limits crossed": (("joints", 6, "lower"), 500, "joints.wrist_roll.lower: got 500"),
    "effort limit zero": (("joints", 0, "effort_limit"), 0, "joints.outer_yaw.effort_limit: got 0"),
    "matrix short": (("actuator_to_joint",), [[1]], "actuator_to_joint: got [[1]]"),
    "matrix ragged": (("actuator_to_joint", 3), [1, 2], "actuator_to_joint[3]: got [1, 2]"),
    "matrix entry": (("actuator_to_joint", 3, 5), "x", "actuator_to_joint[3][5]: got 'x'"),
    "matrix singular": (("actuator_to_joint", 3), [0] * 7, "an invertible matrix"),
    "motor limit negative": (("actuator_effort_limit", 2), -1, "of elbow_pitch: got -1.0"),
    "motor limits short": (("actuator_effort_limit",), [1, 2], "actuator_effort_limit: got [1, 2]"),
    "bar of no length": (("parallelogram",), 0, "parallelogram: got 0"),
    "base": (("base_rpy", 1), None, "base_rpy[1]: got nothing"),
}


@pytest.mark.parametrize("case", WRONG)
def test_a_wrong_field_is_told_in_one_line_with_file_field_and_joint(case, tmp_path):
    path, value, told = WRONG[case]
    content = yaml.safe_load((CONFIG / "arms" / "mtml.yaml").read_text())
    node = content
    for key in path[:-1]:
        node = node[key]
    if value is MISSING:
        del node[path[-1]]
    else:
        node[path[-1]] = value
    file = tmp_path / "mine.yaml"
    file.write_text(yaml.safe_dump(content))
    with pytest.raises(ConfigError) as caught:
        Arm.load(file)
    text = str(caught.value)
    assert text.startswith(f"{file}: ")
    assert told in text
    assert ", expected " in text
    assert "\n" not in text


@pytest.mark.parametrize("name", ["psm1", "", "../../../arm", "/etc/passwd", "a\0b", "x" * 5000])
def test_a_name_that_is_no_shipped_arm_is_refused(name):
    with pytest.raises(
        ConfigError, match=r"arm: got .*, expected mtml, mtmr, psm, ecm, or the path"
    ):
        Arm.load(name)


def test_the_arms_that_are_said_to_be_supported_load():
    from dvrk_gravity.arms import SUPPORTED
    from dvrk_gravity.files.resources import config_path

    names = SUPPORTED.split(", ")
    for name in ("mtml", "mtmr"):
        assert name in names
        assert (
            Arm.load(name).lower.tolist()
            == Arm.load(config_path(f"arms/{name}.yaml")).lower.tolist()
        )
