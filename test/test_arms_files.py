"""Arms from files: what YAML and URDF hold, and what is said of files that are wrong."""

from __future__ import annotations

import sys
from xml.etree import ElementTree

import numpy as np
import pytest
import yaml
from made_up_arm import FILE, made_up_arm, write
from robots import PANDA, UR5

from dvrk_gravity.arms import Arm, is_mtm
from dvrk_gravity.effects import link_sizes, links_of_joints, prior_scale
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


def test_a_joint_s_link_may_move_by_other_joints_too(tmp_path):
    arm = Arm.load(write(tmp_path, joint(3, follows={"yaw": -0.5})))
    np.testing.assert_array_equal(arm.body("link4").row, [-0.5, 0, 0, 1])
    assert links_of_joints(arm)[3] == arm.body_names.index("link4")


def test_sizes_of_links_are_those_of_the_file_as_far_as_it_has_them(tmp_path):
    arm = Arm.load(write(tmp_path, {"sizes": {"link2": [3.0, 0.4]}}))
    sizes = dict(zip(arm.body_names, link_sizes(arm), strict=True))
    assert sizes["link2"] == (3.0, 0.4)
    assert sizes["link4"] == (1.0, 0.1)  # nothing is known of it


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


IN_RANGE = "expected a number from -1e+06 to 1e+06"
WRONG_YAML = {
    "kind": (joint(2, type="screw"), "joints.insertion.type: got 'screw', expected one of rev"),
    "range": (joint(2, lower=0.5), "joints.insertion.lower: got 0.5, expected less than upper"),
    "force": (joint(2, effort_limit=0), "joints.insertion.effort_limit: got 0, expected more tha"),
    "convention": ({"convention": "other"}, "convention: got 'other', expected one of standard"),
    "parent": (follower(0, parent="link9"), "followers.counterweight.parent: got 'link9'"),
    "later parent": (follower(1, parent="wheel"), "followers.lever.parent: got 'wheel'"),
    "same name": (follower(1, name="link1"), "followers[1].name: got 'link1', expected a name"),
    "no master": (follower(1, follows={}), "followers.lever.follows: got {}"),
    "strange master": (follower(1, follows={"jaw": 1}), "followers.lever.follows: got 'jaw'"),
    "factor": (follower(1, follows={"yaw": "x"}), "followers.lever.follows.yaw: got 'x'"),
    "motors without limits": (
        {"actuator_effort_limit": None},
        "actuator_effort_limit: got nothing",
    ),
    "parallelogram": ({"parallelogram": 0.1}, "followers: got"),
    "link that follows nothing": (joint(3, follows={}), "joints.roll.follows: got {}"),
    "link that follows what is not there": (
        joint(3, follows={"jaw": 1}), "joints.roll.follows: got 'jaw', expected one of yaw",
    ),
    "link that follows its own joint": (
        joint(3, follows={"roll": 1}), "joints.roll.follows: got 'roll', expected other joints",
    ),
    "size of no link": ({"sizes": {"jaw": [1, 0.1]}}, "sizes: got 'jaw', expected one of link1"),
    "size of one number": ({"sizes": {"link1": [1]}}, "sizes.link1: got [1], expected a list of 2"),
    "no mass": ({"sizes": {"link1": [0, 0.1]}}, "sizes.link1: got [0, 0.1], expected a mass and"),
    "sizes that are a list": ({"sizes": [1]}, "sizes: got [1], expected LINK: [kg, m]"),
    "no length": (joint(2, d=1e300), f"joints.insertion.d: got 1e+300, {IN_RANGE}"),
    "no integer": (joint(2, a=10**400), "joints.insertion.a: got 1000"),
    "no factor": (
        joint(3, follows={"yaw": -1e300}), f"joints.roll.follows.yaw: got -1e+300, {IN_RANGE}",
    ),
    "no place": (
        follower(0, xyz=[0, 1e300, 0]), f"followers.counterweight.xyz[1]: got 1e+300, {IN_RANGE}",
    ),
    "no size": ({"sizes": {"link1": [1, 1e200]}}, f"sizes.link1[1]: got 1e+200, {IN_RANGE}"),
    "no transmission": (
        {"actuator_to_joint": (1e200 * np.eye(4)).tolist()},
        f"actuator_to_joint[0][0]: got 1e+200, {IN_RANGE}",
    ),
    "no base": ({"base_rpy": [1e308, 0, 0]}, f"base_rpy[0]: got 1e+308, {IN_RANGE}"),
    "no effort": (
        {"actuator_effort_limit": [40, 35, 1e7, 5]},
        f"actuator_effort_limit of insertion: got 10000000.0, {IN_RANGE}",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", WRONG_YAML)
def test_what_is_wrong_in_a_chain_s_file_is_told_in_one_line(case, tmp_path):
    changes, told = WRONG_YAML[case]
    path = write(tmp_path, changes)
    with pytest.raises(ConfigError) as caught:
        Arm.load(path)
    assert str(caught.value).startswith(f"{path}: {told}")
    assert "\n" not in str(caught.value)


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


def test_a_stated_velocity_limit_is_the_joint_s_and_none_is_no_limit(tmp_path):
    slow = LIMIT.replace('velocity="4"', 'velocity="0.1"')
    none = LIMIT.replace('velocity="4"', 'velocity="0"')
    joints = a_joint("one", "a", "b", inner=slow), a_joint("two", "b", "c", inner=none)
    arm = Arm.load(urdf(tmp_path, *joints, links="abc"))
    assert [joint.velocity_limit for joint in arm.joints] == [0.1, np.inf]


def test_a_chain_s_velocity_limits_are_in_degrees_or_metres_per_second(tmp_path):
    turns, slides, free = ({"velocity_limit": 90}, {"velocity_limit": 0.2}, {})
    path = write(tmp_path, FILE | {"joints": [
        {**row, **change} for row, change in zip(FILE["joints"], (turns, free, slides, free),
                                                 strict=True)]})  # fmt: skip
    found = [joint.velocity_limit for joint in Arm.load(path).joints]
    np.testing.assert_allclose(found, [np.pi / 2, np.inf, 0.2, np.inf])
    with pytest.raises(ConfigError, match=r"yaw\.velocity_limit: got 0"):
        Arm.load(write(tmp_path, FILE | {"joints": [FILE["joints"][0] | {"velocity_limit": 0}]}))


def test_mimic_joints_are_bodies_that_follow():
    arm = Arm.from_urdf(PANDA)
    assert arm.joint_names[-1] == "panda_finger_joint1"
    assert (arm.joints[-1].kind, arm.joints[-1].effort_unit) == ("prismatic", "N")
    assert arm.body_names[-2:] == ("panda_leftfinger", "panda_rightfinger")
    np.testing.assert_array_equal(arm.expand[-2:, -1], [1, 1])
    assert Arm.from_urdf(PANDA, "panda_hand").n == 7


LINK = '<link name="{}"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>'  # noqa: E501
LIMIT = '<limit lower="-1" upper="2" effort="3" velocity="4"/>'


def a_joint(name, parent, child, kind="revolute", inner=LIMIT, axis="0 0 1") -> str:
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="0.1 0 0.2" rpy="0.3 0 0"/><axis xyz="{axis}"/>{inner}</joint>'
    )


def urdf(folder, *joints: str, links: str = "abcd", head: str = '<robot name="r">'):
    path = folder / "robot.urdf"
    whole = head + "".join(LINK.format(link) for link in links) + "".join(joints) + "</robot>"
    path.write_text(whole)
    return path


def mimic(master: str, factor: float | str = 1.0, offset: float = 0.0) -> str:
    return f'{LIMIT}<mimic joint="{master}" multiplier="{factor}" offset="{offset}"/>'


def test_a_continuous_joint_has_no_end_and_fixed_ones_are_merged(tmp_path):
    path = urdf(
        tmp_path,
        a_joint("one", "a", "b", "continuous", axis="0 -1 0"),
        a_joint("glue", "b", "c", "fixed", ""),
        a_joint("two", "c", "d"),
    )
    arm = Arm.from_urdf(path)
    assert arm.joint_names == ("one", "two")
    np.testing.assert_array_equal([arm.lower[0], arm.upper[0]], [-np.inf, np.inf])
    np.testing.assert_array_equal(arm.range, [[-np.pi, -1], [np.pi, 2]])
    np.testing.assert_array_equal(arm.inertial_parameters[:, 0], [2, 1])


def test_what_a_file_says_of_the_axis_of_a_joint_that_does_not_move_is_not_asked_for(tmp_path):
    """A Kinova's file has no direction there."""
    glued = a_joint("glue", "a", "b", "fixed", axis="0 0 0")
    arm = Arm.from_urdf(urdf(tmp_path, glued, a_joint("one", "b", "c"), links="abc"))
    assert arm.joint_names == ("one",)


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
WRONG_URDF = {
    "joint type": (
        (a_joint("one", "a", "b", "screw"), TWO), "abc", "joint one: type: got 'screw', expected",
    ),
    "floating": (
        (a_joint("one", "a", "b", "floating"), TWO), "abc",
        "joint one: type: got 'floating', expected revolute, continuous, prismatic, fixed (fixed,",
    ),
    "planar": (
        (a_joint("one", "a", "b", "planar"), TWO), "abc", "joint one: type: got 'planar'",
    ),
    "upside down": (
        (a_joint("one", "a", "b", inner='<limit lower="1" upper="-1" effort="2" velocity="1"/>'),),
        "ab", "joint one: limit lower: got 1.0, expected less than upper (-1); a joint without",
    ),
    "no way to slide": (
        (a_joint("one", "a", "b", "prismatic", '<limit effort="2" velocity="1"/>'),), "ab",
        "joint one: limit lower: got 0.0, expected less than upper (0)",
    ),
    "degrees": (
        (a_joint("one", "a", "b", inner='<limit lower="-170" upper="170" effort="2"/>'),), "ab",
        "joint one: limit lower: got -170.0, expected rad, at most 12.57 as of any joint "
        "(-170 deg is -2.967 rad); a joint without stops has type continuous",
    ),
    "degrees one way": (
        (ONE, a_joint("two", "b", "c", inner='<limit lower="0" upper="90"/>')), "abc",
        "joint two: limit upper: got 90.0, expected rad, at most 12.57 as of any joint (90 deg is",
    ),
    "millimetres": (
        (a_joint("one", "a", "b", "prismatic", '<limit lower="0" upper="240" effort="2"/>'),), "ab",
        "joint one: limit upper: got 240.0, expected m, at most 10 as of any joint (240 mm is 0.24",
    ),
    "degrees of a follower": (
        (ONE, a_joint("two", "b", "c", inner=mimic("one").replace('lower="-1"', 'lower="-90"'))),
        "abc", "joint two: limit lower: got -90.0, expected rad",
    ),
    "limit as text": (
        (a_joint("one", "a", "b", inner='<limit lower="x" upper="1" effort="1" velocity="1"/>'),),
        "ab", "joint one: limit lower: got 'x', expected a finite number",
    ),
    "mimic loop": (
        (a_joint("one", "a", "b", inner=mimic("two")), a_joint("two", "b", "c", inner=mimic("one")),
         a_joint("three", "c", "d")), "abcd", "joint one: mimic: got 'a loop: one, two, one'",
    ),
    "mimic of itself": (
        (a_joint("one", "a", "b", inner=mimic("one")), TWO), "abc",
        "joint one: mimic: got 'a loop: one, one'",
    ),
    "mimic by a text": (
        (ONE, a_joint("two", "b", "c", inner=mimic("one", "1,0"))), "abc",
        "joint two: mimic multiplier: got '1,0', expected a finite number",
    ),
    "mimic by nan": (
        (ONE, a_joint("two", "b", "c", inner=mimic("one", np.nan))), "abc",
        "joint two: mimic multiplier: got 'nan', expected a finite number",
    ),
    "mimic by too much": (
        (ONE, a_joint("two", "b", "c", inner=mimic("one", 1e300))), "abc",
        f"joint two: mimic multiplier: got 1e+300, {IN_RANGE}",
    ),
    "mimic of no joint": (
        (ONE, a_joint("two", "b", "c", inner=f"{LIMIT}<mimic/>")), "abc",
        "joint two: mimic joint: got nothing, expected the joint that it follows",
    ),
    "mimic of nothing": (
        (a_joint("one", "a", "b", inner=mimic("jaw")), TWO), "abc", "joint one: mimic: got 'jaw'",
    ),
    "strange link": ((ONE, a_joint("two", "b", "z")), "ab", "joint two: child: got 'z'"),
    "two parents": ((ONE, a_joint("two", "a", "b")), "ab", "link b: got 'the child of two joints'"),
    "loop": ((ONE, a_joint("two", "b", "a")), "ab", "link: got [], expected one link"),
    "loop off the tree": (
        (ONE, a_joint("two", "c", "d"), a_joint("three", "d", "c")), "abcd",
        "joint two, three: got 'a loop of c, d', expected a tree of links from a",
    ),
    "link twice": ((ONE, TWO), "abcb", "link: got 'b', expected a name that no other link has"),
    "link without a name": (
        (ONE, a_joint("two", "b", "")), ("a", "b", ""), "link: got '', expected a name",
    ),
    "damping as text": (
        (a_joint("one", "a", "b", inner=f'{LIMIT}<dynamics damping="x"/>'),), "ab",
        "joint one: dynamics damping: got 'x', expected a finite number",
    ),
    "two trees": ((ONE,), "abc", "link: got ['a', 'c'], expected one link"),
    "name twice": ((ONE, a_joint("one", "b", "c")), "abc", "joint: got 'one', expected a name"),
    "nothing moves": ((a_joint("one", "a", "b", "fixed", ""),), "ab", "joint: got 'none of 1"),
}  # fmt: skip


@pytest.mark.parametrize("case", WRONG_URDF)
def test_what_a_urdf_holds_that_no_arm_can_have_is_told_in_one_line(case, tmp_path):
    joints, links, told = WRONG_URDF[case]
    path = urdf(tmp_path, *joints, links=links)
    with pytest.raises(ConfigError) as caught:
        Arm.load(path)
    assert str(caught.value).startswith(f"{path}: {told}"), caught.value
    assert "\n" not in str(caught.value)


def test_a_urdf_that_weighs_nothing_tells_no_masses(tmp_path):
    path = urdf(tmp_path, ONE, links="ab")
    path.write_text(path.read_text().replace('mass value="1"', 'mass value="0"'))
    arm = Arm.load(path)
    assert arm.inertial_parameters is None
    assert np.isfinite(prior_scale(arm)).all()


NOT_URDF = {
    "text": ("hello", "not well-formed|syntax error"),
    "empty": ("", "no element found"),
    "other XML": ("<mujoco/>", "got '<mujoco>', expected a URDF"),
    "empty robot": ("<robot/>", "link: got 'none', expected a URDF with links and joints"),
    "two robots": ('<robot name="r"/><robot name="s"/>', "junk after document element"),
    "entities": ('<!DOCTYPE r [<!ENTITY x "y">]><robot name="r"/>', "a document type"),
}  # fmt: skip


@pytest.mark.parametrize("case", NOT_URDF)
def test_a_file_that_is_no_urdf_is_refused(case, tmp_path):
    content, told = NOT_URDF[case]
    path = tmp_path / "robot.urdf"
    path.write_text(content)
    with pytest.raises(ConfigError, match=told) as caught:
        Arm.load(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("was", "now", "told"),
    [
        ('mass value="1"', 'mass value="x"', "link a: inertial mass value: got 'x'"),
        ('mass value="1"', 'mass value="-1"', "link a: inertial mass: got -1.0"),
        ('ixx="1" ', "", "link a: inertial inertia ixx: got nothing, expected a finite number"),
        ('effort="3"', 'effort="x"', "joint one: limit effort: got 'x', expected a finite number"),
        ('xyz="0.1 0 0.2"', 'xyz="0.1 0"', "joint one origin xyz: got '0.1 0', expected 3"),
        ('xyz="0 0 1"', 'xyz="0 0 0"', "joint one: axis: got '0 0 0', expected a direction"),
        ('xyz="0 0 1"', 'xyz="0 1e-200 0"', "joint one: axis: got '0 1e-200 0', expected a direct"),
        ('xyz="0 0 1"', 'xyz="0 9e307 9e307"', "joint one: axis: got '0 9e307 9e307', expected a"),
        ('xyz="0.1 0 0.2"', 'xyz="1e300 0 0"', f"joint one origin xyz: got 1e+300, {IN_RANGE}"),
        ('mass value="1"', 'mass value="1e300"', "link a: inertial mass value: got 1e+300"),
        ('izz="1"', 'izz="x"', "link a: inertial inertia izz: got 'x', expected a finite number"),
        ('effort="3"', 'effort="1e300"', f"joint one: limit effort: got 1e+300, {IN_RANGE}"),
    ],
)
def test_a_number_of_a_urdf_that_is_none_is_told(was, now, told, tmp_path):
    """The URDF's reader drops an inertia that it cannot read, and goes on."""
    path = urdf(tmp_path, ONE, links="ab")
    path.write_text(path.read_text().replace(was, now, 1))
    with pytest.raises(ConfigError) as caught:
        Arm.load(path)
    assert str(caught.value).startswith(f"{path}: {told}")


@pytest.mark.parametrize("length", [1e-3, 0.7, 25.0, 1e3])
def test_an_axis_is_a_direction_however_long(length, tmp_path):
    along = a_joint("one", "a", "b", axis=f"0 {0.6 * length} {0.8 * length}")
    (body,) = Arm.load(urdf(tmp_path, along, links="ab")).bodies
    # The axis, z of the body's joint frame, seen from the link's own.
    seen = body.frame.rotation.T @ [0.0, 0.0, 1.0]
    np.testing.assert_allclose(seen, [0.0, 0.6, 0.8], atol=1e-12)


def test_a_moment_of_inertia_that_is_zero_but_for_rounding_is_read(tmp_path):
    """An iCub's file has such."""
    path = urdf(tmp_path, ONE, links="ab")
    path.write_text(path.read_text().replace('ixx="1"', 'ixx="-5.42101e-20"'))
    assert Arm.load(path).n == 1


XACRO = "expected a URDF without xacro: `xacro robot.urdf > robot_expanded.urdf`, or `pip inst"


@pytest.mark.parametrize(
    ("head", "inner", "found"),
    [
        (' xmlns:xacro="http://www.ros.org/wiki/xacro"', "<xacro:arm/>", "<xacro:arm>"),
        (' xmlns:xacro="http://ros.org/wiki/xacro"', "<xacro:arm/>", "<xacro:arm>"),
        ("", "<xacro:arm/>", "<xacro:…>"),
        ("", '<link name="${prefix}c"/>', '<link name="${prefix}c">'),
        ("", '<link name="$(arg prefix)c"/>', '<link name="$(arg prefix)c">'),
    ],
)
def test_what_xacro_has_yet_to_expand_is_found(head, inner, found, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "xacrodoc", None)
    path = urdf(tmp_path, ONE, inner, links="ab", head=f'<robot name="r"{head}>')
    with pytest.raises(ConfigError) as caught:
        Arm.load(path)
    assert str(caught.value).startswith(f"{path}: got '{found}', {XACRO}")


def test_a_file_that_xacro_has_expanded_may_still_name_it(tmp_path):
    head = '<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">'
    assert Arm.load(urdf(tmp_path, ONE, links="ab", head=head)).n == 1


@pytest.mark.parametrize("named", ["nowhere.urdf", "package://robot/robot.urdf"])
def test_a_urdf_that_is_not_there_is_told_with_the_file_that_names_it(named, tmp_path):
    path = tmp_path / "arm.yaml"
    path.write_text(yaml.safe_dump({"urdf": named}))
    with pytest.raises(ConfigError) as caught:
        Arm.load(path)
    assert str(caught.value).startswith(f"{path}: {tmp_path / named}: got 'no such file'")


def test_a_tip_that_is_no_link_and_a_file_that_is_not_there_are_told(tmp_path):
    with pytest.raises(ConfigError, match="tip: got 'jaw', expected a link: "):
        Arm.from_urdf(UR5, "jaw")
    with pytest.raises(ConfigError, match="no such file"):
        Arm.load(tmp_path / "nowhere.urdf")
    with pytest.raises(ConfigError, match="link: got 'jaw', expected one of"):
        Arm.from_urdf(UR5).body("jaw")
