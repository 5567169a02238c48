"""Arms from files: what YAML and URDF hold, and which files are refused."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import yaml
from made_up_arm import FILE, made_up_arm, write
from robots import UR5
from support import CONFIG
from urdf_texts import LIMIT, a_joint, mimic, urdf

from dvrk_gravity.arms import Arm, is_mtm
from dvrk_gravity.errors import ConfigError


def test_a_chain_of_both_kinds_has_units_by_kind(tmp_path):
    arm = made_up_arm(tmp_path)
    assert arm.n == 4
    assert [joint.kind for joint in arm.joints] == ["revolute"] * 2 + ["prismatic", "revolute"]
    assert [joint.unit for joint in arm.joints] == ["rad", "rad", "m", "rad"]
    assert [joint.effort_unit for joint in arm.joints] == ["N·m", "N·m", "N", "N·m"]
    np.testing.assert_allclose(arm.lower, [*np.radians([-120, -80]), 0.02, np.radians(-170)])
    np.testing.assert_array_equal(arm.effort_limit, [40, 35, 60, 5])
    assert not is_mtm(arm)
    assert is_mtm(Arm.load("mtml"))


def test_bodies_are_listed_depth_first_each_after_its_parent(tmp_path):
    arm = made_up_arm(tmp_path)
    assert arm.body_names == (
        "link1", "link2", "counterweight", "lever", "wheel", "link3", "link4"
    )  # fmt: skip
    parents = {
        body.name: arm.body_names[body.parent] if body.parent >= 0 else "" for body in arm.bodies
    }
    assert parents == {
        "link1": "", "link2": "link1", "counterweight": "link2", "lever": "link2",
        "wheel": "lever", "link3": "link2", "link4": "link3",
    }  # fmt: skip
    np.testing.assert_array_equal(arm.body("counterweight").row, [0.02, 0, -0.5, 0])


def test_a_transmission_carries_power_whole(tmp_path):
    arm = made_up_arm(tmp_path)
    rng = np.random.default_rng(0)
    velocity, effort = rng.normal(size=(2, 20, arm.n))
    np.testing.assert_allclose(
        np.sum(arm.joint_position(velocity) * arm.joint_effort(effort), axis=1),
        np.sum(velocity * effort, axis=1),
        atol=1e-12,
    )
    np.testing.assert_allclose(arm.joint_position(velocity)[:, 2], velocity @ [0, 0.1, 0.02, 0])
    np.testing.assert_allclose(arm.actuator_position(arm.joint_position(velocity)), velocity)
    np.testing.assert_allclose(arm.actuator_effort(arm.joint_effort(effort)), effort)


def test_an_arm_without_a_transmission_is_driven_at_its_joints(tmp_path):
    content = {key: FILE[key] for key in ("name", "joints")}
    path = tmp_path / "plain.yaml"
    path.write_text(yaml.safe_dump(content))
    arm = Arm.load(path)
    np.testing.assert_array_equal(arm.actuator_to_joint, np.eye(4))
    np.testing.assert_array_equal(arm.actuator_effort_limit, arm.effort_limit)
    np.testing.assert_array_equal(arm.gravity, [0, 0, -9.81])


def joint(index: int, **changes) -> dict:
    """The file's joints, one of them changed."""
    rows = [dict(row) for row in FILE["joints"]]
    rows[index] |= changes
    return {"joints": rows}


def follower(index: int, **changes) -> dict:
    rows = [dict(row) for row in FILE["followers"]]
    rows[index] |= changes
    return {"followers": rows}


MISSING = object()
IN_RANGE = "expected a number from -1e+06 to 1e+06"
# Of a master arm: where, what is written there, what the refusal names.
WRONG_MTM = {
    "unknown field": (("colour",), "red", "colour: got 'colour'"),
    "missing field": (("parallelogram",), MISSING, "parallelogram: got nothing"),
    "joint of another arm": (("joints", 2, "name"), "elbow", "joints.elbow_pitch: got"),
    "angle of another arm": (("joints", 3, "alpha"), 80, "joints.wrist_platform: got 'alpha 80"),
    "length as text": (("joints", 1, "a"), "long", "joints.shoulder_pitch.a: got 'long'"),
    "limits crossed": (("joints", 6, "lower"), 500, "joints.wrist_roll.lower: got 500"),
    "matrix singular": (("actuator_to_joint", 3), [0] * 7, "an invertible matrix"),
    "motor limit negative": (("actuator_effort_limit", 2), -1, "of elbow_pitch: got -1.0"),
}
WRONG_CHAIN = {
    "kind": (joint(2, type="screw"), "joints.insertion.type: got 'screw', expected one of rev"),
    "parent": (follower(0, parent="link9"), "followers.counterweight.parent: got 'link9'"),
    "motors without limits": ({"actuator_effort_limit": None}, "actuator_effort_limit: got noth"),
    "link that follows its own joint": (
        joint(3, follows={"roll": 1}), "joints.roll.follows: got 'roll', expected other joints",
    ),
    "no length": (joint(2, d=1e300), f"joints.insertion.d: got 1e+300, {IN_RANGE}"),
    "no speed": (joint(0, velocity_limit=0), "joints.yaw.velocity_limit: got 0"),
    "millimetres": (joint(2, upper=240.0), "joints.insertion.upper: got 240.0, expected m, at"),
}  # fmt: skip


def assert_refused(case: str, file: Path, named: str) -> None:
    """Check that an arm's file is refused in one line: file, field, value, what was expected."""
    with pytest.raises(ConfigError) as caught:
        Arm.load(file)
    text = str(caught.value)
    assert text.startswith(f"{file}: "), case
    assert named in text, (case, text)
    assert ", expected " in text, case
    assert "\n" not in text, case


def test_a_wrong_field_of_a_yaml_is_refused_in_one_line_with_file_field_and_joint(tmp_path):
    file = tmp_path / "mine.yaml"
    for case, (path, value, named) in WRONG_MTM.items():
        content = yaml.safe_load((CONFIG / "arms" / "mtml.yaml").read_text())
        node = content
        for key in path[:-1]:
            node = node[key]
        if value is MISSING:
            del node[path[-1]]
        else:
            node[path[-1]] = value
        file.write_text(yaml.safe_dump(content))
        assert_refused(case, file, named)
    for case, (changes, named) in WRONG_CHAIN.items():
        assert_refused(case, write(tmp_path, changes), named)


def test_a_urdf_brings_joints_limits_and_inertia():
    arm = Arm.load(str(UR5))
    assert arm.name == "ur5"
    assert arm.joint_names[:2] == ("shoulder_pan_joint", "shoulder_lift_joint")
    assert arm.body_names[0] == "shoulder_link"
    np.testing.assert_array_equal(arm.effort_limit, [150, 150, 150, 28, 28, 28])
    np.testing.assert_allclose(arm.upper[2], np.pi)
    np.testing.assert_array_equal(arm.actuator_to_joint, np.eye(6))
    assert arm.inertial_parameters.shape == (6, 10)
    robot = ElementTree.parse(UR5).getroot()
    forearm = robot.find("link[@name='forearm_link']/inertial/mass").get("value")
    assert arm.inertial_parameters[2, 0] == float(forearm)
    assert Arm.of(Arm.load(arm.source).source).joint_names == arm.joint_names


def test_a_chain_s_velocity_limits_are_in_degrees_or_metres_per_second(tmp_path):
    turns, slides, free = ({"velocity_limit": 90}, {"velocity_limit": 0.2}, {})
    path = write(tmp_path, FILE | {"joints": [
        {**row, **change} for row, change in zip(FILE["joints"], (turns, free, slides, free),
                                                 strict=True)]})  # fmt: skip
    found = [joint.velocity_limit for joint in Arm.load(path).joints]
    np.testing.assert_allclose(found, [np.pi / 2, np.inf, 0.2, np.inf])


def test_a_continuous_joint_has_no_end_and_fixed_ones_are_merged(tmp_path):
    path = urdf(
        tmp_path,
        a_joint("one", "a", "b", "continuous", axis="0 -1 0"),
        a_joint("glue", "b", "c", "fixed", "", axis="0 0 0"),  # as a Kinova's
        a_joint("two", "c", "d"),
    )
    arm = Arm.from_urdf(path)
    assert arm.joint_names == ("one", "two")
    np.testing.assert_array_equal([arm.lower[0], arm.upper[0]], [-np.inf, np.inf])
    np.testing.assert_array_equal(arm.range, [[-np.pi, -1], [np.pi, 2]])
    np.testing.assert_array_equal(arm.inertial_parameters[:, 0], [2, 1])


def test_a_mimic_of_a_mimic_follows_by_the_product_and_the_offset_moves_its_zero(tmp_path):
    path = urdf(
        tmp_path,
        a_joint("one", "a", "b"),
        a_joint("two", "b", "c", inner=mimic("one", -2.0, 0.25)),
        a_joint("three", "c", "d", inner=mimic("two", 3.0, 0.5)),
    )
    arm = Arm.from_urdf(path)
    np.testing.assert_array_equal(arm.expand[:, 0], [1.0, -2.0, -6.0])
    plain = Arm.from_urdf(urdf(tmp_path, a_joint("one", "a", "b"), a_joint("two", "b", "c"),
                               a_joint("three", "c", "d")))  # fmt: skip
    for body, other, angle in zip(arm.bodies, plain.bodies, (0, 0.25, 3 * 0.25 + 0.5), strict=True):
        turned = other.placement.rotation.T @ body.placement.rotation
        expected = [np.cos(angle), -np.sin(angle), np.sin(angle), np.cos(angle)]
        np.testing.assert_allclose(turned[:2, :2].ravel(), expected, atol=1e-12)


ONE, TWO = a_joint("one", "a", "b"), a_joint("two", "b", "c")
# Joints, links, and what the refusal names.
WRONG_URDF = {
    "joint type": ((a_joint("one", "a", "b", "screw"), TWO), "abc", "joint one: type: got 'screw'"),
    "upside down": (
        (a_joint("one", "a", "b", inner='<limit lower="1" upper="-1" effort="2" velocity="1"/>'),),
        "ab", "joint one: limit lower: got 1.0, expected less than upper (-1)",
    ),
    "degrees": (
        (ONE, a_joint("two", "b", "c", inner='<limit lower="0" upper="90"/>')), "abc",
        "joint two: limit upper: got 90.0, expected rad, at most 12.57",
    ),
    "mimic loop": (
        (a_joint("one", "a", "b", inner=mimic("two")), a_joint("two", "b", "c", inner=mimic("one")),
         a_joint("three", "c", "d")), "abcd", "joint one: mimic: got 'a loop: one, two, one'",
    ),
    "mimic of no joint": (
        (ONE, a_joint("two", "b", "c", inner=f"{LIMIT}<mimic/>")), "abc",
        "joint two: mimic joint: got nothing",
    ),
    "strange link": ((ONE, a_joint("two", "b", "z")), "ab", "joint two: child: got 'z'"),
    "loop off the tree": (
        (ONE, a_joint("two", "c", "d"), a_joint("three", "d", "c")), "abcd",
        "joint two, three: got 'a loop of c, d'",
    ),
    "link twice": ((ONE, TWO), "abcb", "link: got 'b', expected a name that no other link has"),
    "nothing moves": ((a_joint("one", "a", "b", "fixed", ""),), "ab", "joint: got 'none of 1"),
}  # fmt: skip
WRONG_NUMBERS = {
    'mass value="1"': {"x": "link a: inertial mass value: got 'x'",
                       "-1": "link a: inertial mass: got -1.0", "1e300": "got 1e+300"},
    'izz="1"': {"x": "link a: inertial inertia izz: got 'x'"},
    'effort="3"': {"x": "joint one: limit effort: got 'x'", "1e300": f"got 1e+300, {IN_RANGE}"},
    'xyz="0.1 0 0.2"': {"0.1 0": "joint one origin xyz: got '0.1 0', expected 3"},
    'xyz="0 0 1"': dict.fromkeys(("0 0 0", "0 1e-200 0", "0 9e307 9e307"), "joint one: axis: got"),
}  # fmt: skip
NOT_URDF = {
    "other XML": ("<mujoco/>", "got '<mujoco>'"),
    "empty robot": ("<robot/>", "link: got 'none'"),
    "entities": ('<!DOCTYPE r [<!ENTITY x "y">]><robot name="r"/>', "a document type"),
}


def test_what_a_urdf_holds_that_no_arm_can_have_is_refused_in_one_line(tmp_path):
    for case, (joints, links, named) in WRONG_URDF.items():
        assert_refused(case, urdf(tmp_path, *joints, links=links), named)
    for was, values in WRONG_NUMBERS.items():
        for value, named in values.items():
            path = urdf(tmp_path, ONE, links="ab")
            now = f'{was.split(chr(34))[0]}"{value}"'
            path.write_text(path.read_text().replace(was, now, 1))
            assert_refused(now, path, named)
    for case, (content, named) in NOT_URDF.items():
        path = tmp_path / "robot.urdf"
        path.write_text(content)
        assert_refused(case, path, named)


@pytest.mark.parametrize("length", [1e-3, 25.0])
def test_an_axis_is_a_direction_however_long(length, tmp_path):
    along = a_joint("one", "a", "b", axis=f"0 {0.6 * length} {0.8 * length}")
    (body,) = Arm.load(urdf(tmp_path, along, links="ab")).bodies
    # The axis, z of the body's joint frame, seen from the link's own.
    seen = body.frame.rotation.T @ [0.0, 0.0, 1.0]
    np.testing.assert_allclose(seen, [0.0, 0.6, 0.8], atol=1e-12)


def test_a_urdf_or_a_tip_that_is_not_there_is_named_with_the_file_that_names_it(tmp_path):
    path = tmp_path / "arm.yaml"
    path.write_text(yaml.safe_dump({"urdf": "package://robot/robot.urdf"}))
    assert_refused("urdf", path, f"{tmp_path / 'package://robot/robot.urdf'}: got 'no such file'")
    with pytest.raises(ConfigError, match="tip: got 'jaw', expected a link: "):
        Arm.from_urdf(UR5, "jaw")
    with pytest.raises(ConfigError, match="no such file"):
        Arm.load(tmp_path / "nowhere.urdf")
    with pytest.raises(ConfigError, match="link: got 'jaw', expected one of"):
        Arm.from_urdf(UR5).body("jaw")
