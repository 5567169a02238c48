"""URDFs as people find them: limits left out or in other units, masses that no body has, xacro."""

from __future__ import annotations

import json
import re
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from robots import PANDA, ROBOTS, UR5
from test_arms_files import LIMIT, LINK, a_joint, urdf

from dvrk_gravity.__main__ import main
from dvrk_gravity.arms import Arm, nominal_inertias
from dvrk_gravity.compensate import Settings
from dvrk_gravity.diagnosis import diagnose
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.identification import identify
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.planning import PlanLimits
from dvrk_gravity.simulate import PlantFile
from testing.plain_world import PlainWorld

pytestmark = pytest.mark.usefixtures("four_folds", "brief_simulation")
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


def without_efforts(folder: Path, source: str | Path = UR5, effort: str = "0") -> Path:
    """An arm's file as exporters write one that states no largest effort, and no velocity."""
    path, link = folder / "robot.urdf", str(source).partition("#")[2]
    text = Path(str(source).partition("#")[0]).read_text()
    for key in ("effort", "velocity"):
        text = re.sub(rf'(<limit[^>]*?) {key}="[^"]*"', rf'\1 {key}="{effort}"', text)
    path.write_text(text)
    return Path(f"{path}#{link}") if link else path


def small(
    folder: Path, name: str = "robot.urdf", limit: str = "", moments: str = "0.02 0.02 0.01"
) -> Path:
    """An arm of two joints, which lean."""
    xx, yy, zz = moments.split()
    link = (
        '<link name="{}"><inertial><origin xyz="0 0.05 0.1"/><mass value="2"/><inertia ixx="{}" '
        'iyy="{}" izz="{}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    )
    limit = limit or '<limit lower="-1.5" upper="2" effort="30" velocity="3"/>'
    lower = a_joint("one", "a", "b", inner=limit, axis="0 1 0")
    upper = a_joint("two", "b", "c", inner=limit, axis="1 0 0")
    path = folder / name
    links = link.format("b", xx, yy, zz) + link.format("c", 0.02, 0.02, 0.01)
    path.write_text(f'<robot name="r"><link name="a"/>{links}{lower}{upper}</robot>')
    return path


# --- limits that are not stated ---------------------------------------------------------------

UNSTATED = {
    "placeholder": '<limit lower="-1" upper="2" effort="0" velocity="0"/>',
    "none": '<limit lower="-1" upper="2"/>',
    "infinite": '<limit lower="-1" upper="2" effort="inf" velocity="Infinity"/>',
    "less than none": '<limit lower="-1" upper="2" effort="-1" velocity="-1"/>',
}


@pytest.mark.parametrize("case", UNSTATED)
def test_an_effort_and_a_velocity_that_no_joint_has_are_not_stated(case, tmp_path):
    joints = a_joint("one", "a", "b", inner=UNSTATED[case]), a_joint("two", "b", "c")
    found, usual = Arm.load(urdf(tmp_path, *joints, links="abc")).joints
    assert (found.effort_stated, found.velocity_limit, found.upper) == (False, np.inf, 2.0)
    assert 0.0 < found.effort_limit < 1e3
    assert (usual.effort_stated, usual.effort_limit, usual.velocity_limit) == (True, 3.0, 4.0)


@pytest.mark.parametrize("inner", ["", '<limit effort="3" velocity="4"/>'])
@pytest.mark.parametrize("kind", ["continuous", "revolute"])
def test_a_joint_that_turns_needs_no_limits(kind, inner, tmp_path):
    (joint,) = Arm.load(urdf(tmp_path, a_joint("one", "a", "b", kind, inner), links="ab")).joints
    assert (joint.lower, joint.upper) == (-np.inf, np.inf)
    assert joint.range_stated == (kind == "continuous")


@pytest.mark.parametrize("limit", ["1e16", "inf"])
def test_the_limit_that_simulators_write_where_there_is_none_is_none(limit, tmp_path):
    inner = f'<limit lower="-{limit}" upper="{limit}" effort="3" velocity="4"/>'
    (joint,) = Arm.load(urdf(tmp_path, a_joint("one", "a", "b", inner=inner), links="ab")).joints
    assert (joint.upper, joint.range_stated) == (np.inf, True)


def test_a_mimic_joint_needs_no_limits(tmp_path):
    follower = a_joint("two", "b", "c", inner='<mimic joint="one"/>')
    arm = Arm.load(urdf(tmp_path, a_joint("one", "a", "b"), follower, links="abc"))
    assert arm.joint_names == ("one",)


@pytest.mark.parametrize("source", [UR5, KINOVA, XARM, f"{PANDA}#panda_hand"])
def test_a_supposed_effort_is_of_the_size_of_the_stated_one(source, tmp_path):
    stated = Arm.load(source).effort_limit
    arm = Arm.load(without_efforts(tmp_path, source))
    ratio = arm.effort_limit / stated
    assert (ratio > 0.1).all()
    assert (ratio < 1.5).all()


def test_a_file_without_masses_supposes_efforts_too(tmp_path):
    path = urdf(tmp_path, a_joint("one", "a", "b", "continuous", ""), links="ab")
    path.write_text(re.sub("<inertial>.*?</inertial>", "", path.read_text()))
    arm = Arm.load(path)
    assert arm.inertial_parameters is None
    assert 1.0 < arm.effort_limit[0] < 10.0


def test_identify_diagnose_and_convert_need_no_effort_limit(tmp_path):
    path = small(tmp_path, limit='<limit lower="-1.5" upper="2" effort="0" velocity="0"/>')
    stated = Arm.load(small(tmp_path, "stated.urdf"))
    PlainWorld.of(stated, nominal_inertias(stated)).record(1, 12.0).save(tmp_path / "motion.csv")
    motion, arm, model = str(tmp_path / "motion.csv"), str(path), str(tmp_path / "model.yaml")
    assert main(["identify", motion, "--arm", arm, "--out", model]) == 0
    assert main(["convert", arm, str(tmp_path / "stated.yaml")]) == 0
    assert main(["diagnose", motion, "--model", arm, "--out", str(tmp_path / "out")]) == 0
    findings = json.loads((tmp_path / "out" / "findings.json").read_text())
    found = {finding["effect"] for finding in findings["findings"]}
    assert found <= {"coulomb_friction", "viscous_friction"}


def test_an_arm_of_seven_joints_is_identified_without_an_effort_limit(tmp_path):
    source = f"{PANDA}#panda_hand"
    stated, path = Arm.load(source), without_efforts(tmp_path, source)
    motion = replace(PlainWorld.of(stated, nominal_inertias(stated)).record(1, 12.0), arm=None)
    assert identify([motion], path).verdict.level == "good"


def test_the_compensator_asks_for_an_effort_limit_and_says_where_it_belongs(tmp_path):
    path = without_efforts(tmp_path)
    values = TorqueModel.stated(Arm.load(path)).parameters()
    with pytest.raises(ConfigError) as caught:
        Settings.from_parameters(values)
    said = str(caught.value)
    assert "\n" not in said
    assert "effort_limit: got 'none of shoulder_pan_joint, shoulder_lift_joint, elbow_" in said
    for place in (str(path), '<limit effort="…"/>', "actuator_effort_limit", "parameter"):
        assert place in said
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
    values = TorqueModel.stated(Arm.load(path)).parameters()
    settings = Settings.from_parameters(values | {"effort_limit": (100.0,) * 6})
    np.testing.assert_array_equal(settings.limits.joint, [100.0] * 3 + [28.0] * 3)


@pytest.mark.parametrize("scale", [1.0, 0.5])
def test_a_yaml_s_actuator_limits_are_those_of_joints_that_state_none(scale, tmp_path):
    without_efforts(tmp_path)
    content = {"urdf": "robot.urdf", "actuator_effort_limit": [10.0, 20.0, 30.0, 4.0, 5.0, 6.0]}
    if scale != 1.0:
        content["actuator_to_joint"] = (scale * np.eye(6)).tolist()
    (tmp_path / "arm.yaml").write_text(yaml.safe_dump(content))
    arm = Arm.load(tmp_path / "arm.yaml")
    np.testing.assert_allclose(arm.effort_limit, np.array([10, 20, 30, 4, 5, 6]) / scale)
    assert all(joint.effort_stated for joint in arm.joints)


def test_efforts_beyond_what_is_supposed_are_read(tmp_path):
    """Nothing tells that they are in another unit, unless the masses do."""
    stated = Arm.load(small(tmp_path))
    recording = PlainWorld.of(stated, nominal_inertias(stated)).record(1, 12.0)
    path = small(tmp_path, limit='<limit lower="-1.5" upper="2"/>')
    path.write_text(re.sub("<inertial>.*?</inertial>", "", path.read_text()))
    arm = Arm.load(path)
    most = np.abs(recording.effort).max(axis=0)
    loud = replace(recording, effort=recording.effort * 30.0 * arm.effort_limit / most, arm=None)
    assert identify([loud], arm).model.arm.joint_names == ("one", "two")


# --- limits in other units --------------------------------------------------------------------

PLANNED = {
    "degrees a second": (LIMIT.replace('"4"', '"180"'), "revolute", "180.0, expected rad/s"),
    "mm a second": (LIMIT.replace('"4"', '"250"'), "prismatic", "250.0, expected m/s, at"),
    "not said": ("", "revolute", 'nothing, expected limit lower="…" upper="…" in rad, or type'),
    "as exporters write": (
        '<limit lower="0" upper="0" effort="0" velocity="0"/>', "revolute",
        'nothing, expected limit lower="…" upper="…" in rad',
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", PLANNED)
def test_no_motion_is_planned_within_limits_that_no_joint_has(case, tmp_path):
    inner, kind, said = PLANNED[case]
    arm = Arm.load(urdf(tmp_path, a_joint("one", "a", "b", kind, inner), links="ab"))
    with pytest.raises(ConfigError) as caught:
        PlanLimits.of(arm)
    assert str(caught.value).startswith(f"{arm.source}: joint one: limit")
    assert f"got {said}" in str(caught.value)


def test_excite_refuses_a_range_in_degrees_and_says_what_it_is(tmp_path, capsys):
    path = tmp_path / "robot.urdf"
    path.write_text(PLAIN.replace('lower="-6.28318530718"', 'lower="-360"'))
    assert main(["excite", "--arm", str(path), "--out", str(tmp_path / "bag")]) == 2
    error = capsys.readouterr().err
    assert "joint shoulder_pan_joint: limit lower: got -360.0, expected rad, at most 12.57" in error
    assert "(-360 deg is -6.283 rad)" in error
    assert error.count("\n") == 1


@pytest.mark.parametrize(
    ("index", "changes", "said"),
    [
        (
            2,
            {"upper": 240.0},
            "joints.insertion.upper: got 240.0, expected m, at most 10 as of any",
        ),
        (0, {"upper": 900.0}, "joints.yaw.upper: got 900.0, expected deg, at most 720"),
    ],
)
def test_a_chain_s_limits_in_other_units_are_refused(index, changes, said, tmp_path):
    from made_up_arm import FILE, write

    joints = [row | changes if i == index else row for i, row in enumerate(FILE["joints"])]
    with pytest.raises(ConfigError) as caught:
        Arm.load(write(tmp_path, {"joints": joints}))
    assert said in str(caught.value)


def test_joints_that_do_not_lead_to_the_link_may_be_written_as_anything(tmp_path):
    """A mobile base, and its wheel."""
    wheel = '<limit lower="0" upper="0" effort="0" velocity="0"/>'
    path = urdf(
        tmp_path, a_joint("base", "a", "d", "floating", ""),
        a_joint("plane", "a", "e", "planar", ""), a_joint("slide", "a", "f", "prismatic", wheel),
        a_joint("one", "a", "b"), links="abdef",
    )  # fmt: skip
    assert Arm.load(f"{path}#b").joint_names == ("one",)
    with pytest.raises(ConfigError, match=r"joint base: type: .*robot\.urdf#LINK"):
        Arm.load(path)


# --- masses that no body has ------------------------------------------------------------------

HALF_TURN = '<origin xyz="0 0 0" rpy="0 0 0.7853981633974483"/>'
DOUBTED = {
    "negative": (
        INERTIA, '<inertia ixx="-0.1" ixy="0" ixz="0" iyy="0.2" iyz="0" izz="0.2"/>',
        "principal moments -0.1, 0.2, 0.2 kg·m^2: one is negative",
    ),
    "not definite, though no diagonal one is negative": (
        INERTIA, '<inertia ixx="0.1" ixy="0.2" ixz="0" iyy="0.1" iyz="0" izz="0.2"/>',
        "principal moments -0.1, 0.2, 0.3 kg·m^2: one is negative",
    ),
    "triangle": (
        INERTIA, '<inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.9"/>',
        "principal moments 0.1, 0.1, 0.9 kg·m^2: the largest is more than the two others together",
    ),
    "triangle, though the diagonal ones keep it": (
        INERTIA, '<inertia ixx="0.5" ixy="0.4" ixz="0" iyy="0.5" iyz="0" izz="0.1"/>',
        "principal moments 0.1, 0.1, 0.9 kg·m^2: the largest is more than the two others together",
    ),
    "another unit": (
        INERTIA, '<inertia ixx="1e5" ixy="0" ixz="0" iyy="1e5" iyz="0" izz="1e5"/>',
        "principal moments 1e+05, 1e+05, 1e+05 kg·m^2: of 8.393 kg they lie 134 m from its centre",
    ),
    "no mass": (MASS, "", "link upper_arm_link: <inertial> without <mass>: counted as weightless"),
    "no inertia": (INERTIA, "", "upper_arm_link: <inertial> without <inertia>: counted as a point"),
}  # fmt: skip


@pytest.mark.parametrize("case", DOUBTED)
def test_masses_that_no_body_has_are_doubted_by_link(case, tmp_path):
    was, now, said = DOUBTED[case]
    arm = Arm.load(with_links(tmp_path, was, now))
    assert any("upper_arm_link" in line and said in line for line in arm.doubts), arm.doubts


def test_moments_in_a_turned_frame_are_judged_by_the_principal_ones(tmp_path):
    """A rod across: in a frame turned by 45 deg its products are as large as its moments."""
    rod = '<inertia ixx="0.1" ixy="-0.1" ixz="0" iyy="0.1" iyz="0" izz="0.2"/>'
    assert not Arm.load(with_links(tmp_path, INERTIA, HALF_TURN + rod)).doubts


def test_a_base_that_does_not_move_may_have_any_inertia(tmp_path):
    path = urdf(tmp_path, a_joint("one", "a", "b"), links="b")
    base = LINK.format("a").replace('izz="1"', 'izz="-5"')
    path.write_text(path.read_text().replace("<link", f"{base}<link", 1))
    assert not Arm.load(path).doubts


@pytest.mark.parametrize("arm", [UR5, KINOVA, XARM, PANDA])
def test_usual_files_are_not_doubted(arm):
    assert not Arm.load(arm).doubts


@pytest.mark.parametrize("moments", ["-5 0.2 0.2", "0.01 0.01 0.09", "20000 20000 10000"])
def test_a_doubted_link_is_reported_before_any_finding(moments, tmp_path):
    stated = Arm.load(small(tmp_path))
    recording = PlainWorld.of(stated, nominal_inertias(stated)).record(1, 12.0)
    recording = replace(recording, arm=None)
    path = small(tmp_path, moments=moments)
    said = "in the arm's file: link b: an inertia that no body has"
    fitted = identify([recording], path)
    assert str(fitted.warnings[0]).startswith(said)
    assert fitted.verdict.level == "good"  # identification does not use the file's inertia
    diagnosis = diagnose(recording, TorqueModel.load(path), simulated=True)
    assert str(diagnosis.warnings[0]).startswith(said)
    assert json.loads(diagnosis.to_json())["data"]["warnings"][0].startswith(said)


def test_a_link_that_weighs_nothing_is_reported(tmp_path):
    inertial = re.search("<inertial>.*?</inertial>", UPPER_ARM, re.DOTALL)[0]
    (said,) = Arm.load(with_links(tmp_path, inertial, "")).doubts
    assert said.startswith("no mass of upper_arm_link, which a joint moves")


def test_a_simulator_refuses_inertia_by_which_motion_would_take_negative_work(tmp_path):
    heavy = '<inertia ixx="-90" ixy="0" ixz="0" iyy="-90" iyz="0" izz="-90"/>'
    arm = Arm.load(with_links(tmp_path, INERTIA, heavy))
    with pytest.raises(ConfigError, match=r"a positive mass matrix \(link upper_arm_link: an"):
        PlantFile.of(arm).plant()


def test_convert_says_what_is_doubted(tmp_path, capsys):
    path = with_links(tmp_path, *DOUBTED["triangle"][:2])
    assert main(["convert", str(path), str(tmp_path / "model.yaml")]) == 0
    assert f"warning: {path}: link upper_arm_link: an inertia" in capsys.readouterr().err


# --- what else files hold ---------------------------------------------------------------------


def test_what_simulators_and_drivers_read_is_not_looked_at(tmp_path):
    more = (
        '<ros2_control name="x" type="system"><joint name="one"><command_interface name="effort"/>'
        '</joint></ros2_control><gazebo reference="b"><selfCollide>true</selfCollide></gazebo>'
        '<transmission name="t"><joint name="one"/></transmission>'
        '<link name="c"><visual><geometry><mesh filename="$(find none)/c.stl"/></geometry>'
        '</visual><collision><geometry><mesh filename="package://none/c.stl"/></geometry>'
        '</collision></link>'
    )  # fmt: skip
    glued = a_joint("glue", "b", "c", "fixed", "")
    arm = Arm.load(urdf(tmp_path, a_joint("one", "a", "b"), glued, more, links="ab"))
    assert arm.joint_names == ("one",)


def test_a_robot_without_a_name_is_called_as_its_file(tmp_path):
    path = urdf(tmp_path, a_joint("one", "a", "b"), links="ab", head="<robot>")
    assert Arm.load(path).name == "robot"


NOT_ARMS = {
    "alex_psyonic_hands": "mimic: got 'index_q1', expected a joint that moves",
    "allegro_left_hand": "expected one without dots",
    "allegro_right_hand": "expected one without dots",
    "quadrotor_base": "none of 0 that moves",
    "iris_simple": "none of 5 that moves",
    "ur3": "link: got 'none'",  # an empty one
}


def test_the_files_of_many_robots_are_read():
    refused = {}
    files = sorted(ROBOTS.rglob("*.urdf"))
    for path in files:
        try:
            assert (Arm.load(path).effort_limit > 0.0).all()
        except ConfigError as error:
            refused[path.stem] = str(error)
    assert len(files) > 50
    assert refused.keys() == NOT_ARMS.keys()
    assert all(NOT_ARMS[name] in said for name, said in refused.items())


# --- xacro ------------------------------------------------------------------------------------

XACRO = f"""<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">
<xacro:arg name="prefix" default=""/><xacro:property name="reach" value="${{0.5 + 0.25}}"/>
<xacro:macro name="part" params="name">{LINK.format("${name}")}</xacro:macro>
<xacro:part name="$(arg prefix)a"/><xacro:part name="$(arg prefix)b"/>
<joint name="one" type="revolute"><parent link="a"/><child link="b"/>
<origin xyz="0 0 ${{reach}}"/><axis xyz="0 1 0"/>{LIMIT}</joint></robot>"""


@pytest.mark.parametrize("name", ["robot.urdf.xacro", "robot.urdf", "robot.xacro"])
def test_what_xacro_has_yet_to_expand_is_expanded(name, tmp_path):
    path = tmp_path / name
    path.write_text(XACRO)
    arm = Arm.load(path)
    assert arm.bodies[0].placement.translation[2] == 0.75
    assert Arm.load(f"{path}#b").joint_names == ("one",)
    assert TorqueModel.load(path).arm.source == str(path)


@pytest.mark.parametrize(
    ("name", "command"),
    [
        ("robot.urdf.xacro", "`xacro robot.urdf.xacro > robot.urdf`"),
        ("robot.urdf", "`xacro robot.urdf > robot_expanded.urdf`"),
    ],
)
def test_without_xacrodoc_the_way_out_is_said(name, command, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "xacrodoc", None)
    path = tmp_path / name
    path.write_text(XACRO)
    with pytest.raises(ConfigError) as caught:
        Arm.load(path)
    expected = f"a URDF without xacro: {command}, or `pip install xacrodoc`"
    assert str(caught.value) == f"{path}: got '<xacro:arg>', expected {expected}"


@pytest.mark.parametrize("broken", ["${nothing}", "$(arg nothing)", "$(find nothing)/a.xacro"])
def test_what_xacro_cannot_expand_is_refused_in_a_line(broken, tmp_path):
    path = tmp_path / "robot.urdf.xacro"
    path.write_text(XACRO.replace("${reach}", broken))
    with pytest.raises(ConfigError) as caught:
        Arm.load(path)
    assert str(caught.value).startswith(f"{path}: got \"xacro's ")
    assert "`xacro robot.urdf.xacro > robot.urdf`" in str(caught.value)
    assert "\n" not in str(caught.value)
