"""URDFs as people find them: limits left out or in other units, masses that no body has, xacro."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import yaml
from robots import PANDA, ROBOTS, UR5
from urdf_texts import LIMIT, LINK, a_joint, urdf

from dvrk_gravity.arms import Arm
from dvrk_gravity.compensate import Settings
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.planning import PlanLimits
from dvrk_gravity.simulate import PlantFile

KINOVA = ROBOTS / "kinova_description" / "robots" / "kinova.urdf"
XARM = ROBOTS / "xarm_description" / "urdf" / "xarm7.urdf"
PLAIN = Path(UR5).read_text()
UPPER_ARM = re.search(r'<link name="upper_arm_link">.*?</link>', PLAIN, re.DOTALL)[0]
MASS = re.search(r'<mass value="[^"]*"/>', UPPER_ARM)[0]
INERTIA = re.search(r"<inertia [^>]*/>", UPPER_ARM)[0]


def with_links(folder: Path, was: str, now: str) -> Path:
    """A UR5's file with something else in its upper arm."""
    path = folder / "robot.urdf"
    assert was in UPPER_ARM
    path.write_text(PLAIN.replace(UPPER_ARM, UPPER_ARM.replace(was, now)))
    return path


def without_efforts(folder: Path) -> Path:
    """A UR5's file as exporters write one that states no largest effort, and no velocity."""
    path, text = folder / "robot.urdf", PLAIN
    for key in ("effort", "velocity"):
        text = re.sub(rf'(<limit[^>]*?) {key}="[^"]*"', rf'\1 {key}="0"', text)
    path.write_text(text)
    return path


# --- limits that are not stated ---------------------------------------------------------------

UNSTATED = {
    "placeholder": '<limit lower="-1" upper="2" effort="0" velocity="0"/>',
    "none": '<limit lower="-1" upper="2"/>',
    "infinite": '<limit lower="-1" upper="2" effort="inf" velocity="Infinity"/>',
    "less than none": '<limit lower="-1" upper="2" effort="-1" velocity="-1"/>',
}


def test_an_effort_and_a_velocity_that_no_joint_has_are_not_stated(tmp_path):
    for case, limit in UNSTATED.items():
        joints = a_joint("one", "a", "b", inner=limit), a_joint("two", "b", "c")
        found, usual = Arm.load(urdf(tmp_path, *joints, links="abc")).joints
        assert (found.effort_stated, found.velocity_limit, found.upper) == (False, np.inf, 2.0), (
            case
        )
        assert 0.0 < found.effort_limit < 1e3, case
        assert (usual.effort_stated, usual.effort_limit, usual.velocity_limit) == (True, 3.0, 4.0)


def test_a_joint_that_turns_needs_no_limits(tmp_path):
    endless = '<limit lower="-1e16" upper="1e16" effort="3" velocity="4"/>'  # as simulators write
    for kind, inner, stated in (
        ("continuous", "", True), ("revolute", '<limit effort="3" velocity="4"/>', False),
        ("revolute", endless, True),
    ):  # fmt: skip
        path = urdf(tmp_path, a_joint("one", "a", "b", kind, inner), links="ab")
        (joint,) = Arm.load(path).joints
        assert (joint.lower, joint.upper) == (-np.inf, np.inf)
        assert joint.range_stated == stated


def test_the_compensator_asks_for_an_effort_limit_and_says_where_it_belongs(tmp_path):
    path = without_efforts(tmp_path)
    values = TorqueModel.from_arm(Arm.load(path)).parameters()
    with pytest.raises(ConfigError) as caught:
        Settings.from_parameters(values)
    said = str(caught.value)
    assert "\n" not in said
    assert said.startswith(f"{path}: effort_limit: got 'none of shoulder_pan_joint, ")
    given = (150.0, 150.0, 150.0, 28.0, 28.0, 0.0)
    with pytest.raises(ConfigError, match="none of"):
        Settings.from_parameters(values | {"effort_limit": given})
    settings = Settings.from_parameters(values | {"effort_limit": (*given[:5], 28.0)})
    np.testing.assert_array_equal(settings.model.arm.effort_limit, (*given[:5], 28.0))
    np.testing.assert_array_equal(settings.limits.joint, (*given[:5], 28.0))
    np.testing.assert_array_equal(settings.limits.actuator, (*given[:5], 28.0))


def test_a_limit_that_the_file_states_binds_beside_those_that_the_parameter_does(tmp_path):
    path = tmp_path / "robot.urdf"
    path.write_text(PLAIN.replace('effort="150.0"', 'effort="0"'))
    values = TorqueModel.from_arm(Arm.load(path)).parameters()
    settings = Settings.from_parameters(values | {"effort_limit": (100.0,) * 6})
    np.testing.assert_array_equal(settings.limits.joint, [100.0] * 3 + [28.0] * 3)


def test_a_yaml_s_actuator_limits_are_those_of_joints_that_state_none(tmp_path):
    without_efforts(tmp_path)
    content = {"urdf": "robot.urdf", "actuator_effort_limit": [10.0, 20.0, 30.0, 4.0, 5.0, 6.0],
               "actuator_to_joint": (0.5 * np.eye(6)).tolist()}  # fmt: skip
    (tmp_path / "arm.yaml").write_text(yaml.safe_dump(content))
    arm = Arm.load(tmp_path / "arm.yaml")
    np.testing.assert_allclose(arm.effort_limit, np.array([10, 20, 30, 4, 5, 6]) / 0.5)
    assert all(joint.effort_stated for joint in arm.joints)


# --- limits in other units --------------------------------------------------------------------

PLANNED = [
    (LIMIT.replace('"4"', '"180"'), "revolute", "180.0, expected rad/s"),
    (LIMIT.replace('"4"', '"250"'), "prismatic", "250.0, expected m/s"),
    ("", "revolute", "nothing, expected limit lower="),
    ('<limit lower="0" upper="0" effort="0" velocity="0"/>', "revolute", "nothing, expected limit"),
]


def test_no_motion_is_planned_within_limits_that_no_joint_has(tmp_path):
    for inner, kind, named in PLANNED:
        arm = Arm.load(urdf(tmp_path, a_joint("one", "a", "b", kind, inner), links="ab"))
        with pytest.raises(ConfigError) as caught:
            PlanLimits.of(arm)
        assert str(caught.value).startswith(f"{arm.source}: joint one: limit")
        assert f"got {named}" in str(caught.value)


# --- masses that no body has ------------------------------------------------------------------

DOUBTED = {
    "not definite, though no diagonal one is negative": (
        INERTIA, '<inertia ixx="0.1" ixy="0.2" ixz="0" iyy="0.1" iyz="0" izz="0.2"/>',
        "principal moments -0.1, 0.2, 0.3 kg·m^2",
    ),
    "triangle, though the diagonal ones keep it": (
        INERTIA, '<inertia ixx="0.5" ixy="0.4" ixz="0" iyy="0.5" iyz="0" izz="0.1"/>',
        "principal moments 0.1, 0.1, 0.9 kg·m^2",
    ),
    "another unit": (
        INERTIA, '<inertia ixx="1e5" ixy="0" ixz="0" iyy="1e5" iyz="0" izz="1e5"/>',
        "of 8.393 kg they lie 134 m from its centre",
    ),
    "no mass": (MASS, "", "<inertial> without <mass>"),
    "no inertia": (INERTIA, "", "<inertial> without <inertia>"),
    "nothing": (
        re.search("<inertial>.*?</inertial>", UPPER_ARM, re.DOTALL)[0], "", "no mass of upper_arm"
    ),
}  # fmt: skip


def test_masses_that_no_body_has_are_reported_by_link(tmp_path):
    for case, (was, now, named) in DOUBTED.items():
        doubts = Arm.load(with_links(tmp_path, was, now)).warnings
        assert any("upper_arm_link" in line and named in line for line in doubts), case
    for source in (UR5, KINOVA, XARM, PANDA):
        assert not Arm.load(source).warnings, source


def test_moments_in_a_turned_frame_are_judged_by_the_principal_ones(tmp_path):
    """A rod across: in a frame turned by 45 deg its products are as large as its moments."""
    rod = '<inertia ixx="0.1" ixy="-0.1" ixz="0" iyy="0.1" iyz="0" izz="0.2"/>'
    turned = '<origin xyz="0 0 0" rpy="0 0 0.7853981633974483"/>'
    assert not Arm.load(with_links(tmp_path, INERTIA, turned + rod)).warnings


def test_a_simulator_refuses_inertia_by_which_motion_would_take_negative_work(tmp_path):
    heavy = '<inertia ixx="-90" ixy="0" ixz="0" iyy="-90" iyz="0" izz="-90"/>'
    arm = Arm.load(with_links(tmp_path, INERTIA, heavy))
    with pytest.raises(ConfigError, match="link upper_arm_link"):
        PlantFile.of(arm).plant()


# --- xacro ------------------------------------------------------------------------------------

XACRO = f"""<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">
<xacro:arg name="prefix" default=""/><xacro:property name="reach" value="${{0.5 + 0.25}}"/>
<xacro:macro name="part" params="name">{LINK.format("${name}")}</xacro:macro>
<xacro:part name="$(arg prefix)a"/><xacro:part name="$(arg prefix)b"/>
<joint name="one" type="revolute"><parent link="a"/><child link="b"/>
<origin xyz="0 0 ${{reach}}"/><axis xyz="0 1 0"/>{LIMIT}</joint></robot>"""


@pytest.mark.parametrize("name", ["robot.urdf", "robot.xacro"])
def test_what_xacro_has_yet_to_expand_is_expanded(name, tmp_path):
    path = tmp_path / name
    path.write_text(XACRO)
    arm = Arm.load(path)
    assert arm.bodies[0].placement.translation[2] == 0.75
    assert Arm.load(f"{path}#b").joint_names == ("one",)
    assert TorqueModel.load(path).arm.source == str(path)
