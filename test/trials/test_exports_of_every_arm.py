"""Models of every arm as URDF and MJCF: torques by Pinocchio and MuJoCo, links, names."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
import pytest
from exported import by_mujoco, held_torque, load, most, physical, states, whole, without_dry
from made_up_arm import write
from robots import UR5

from dvrk_gravity.arms import Arm
from dvrk_gravity.effects import LinkInertia, LinkWeight
from dvrk_gravity.exports import export_model
from dvrk_gravity.model import TorqueModel

ARMS = ("mtmr", "mtml", "psm", "ecm", "made_up", "ur5", "panda")


@pytest.fixture(scope="module")
def made_up(tmp_path_factory) -> Path:
    return write(tmp_path_factory.mktemp("arms"))


def by_pinocchio(text: str, arm: Arm, q, qd, qdd) -> np.ndarray:
    """Rigid bodies by Pinocchio's own reader; mimic joints and friction by the XML."""
    model = pin.buildModelFromXML(text)
    data = model.createData()
    described = {j.get("name"): j for j in ElementTree.fromstring(text).findall("joint")}
    expand = np.zeros((model.nv, arm.n))
    for i in range(1, model.njoints):
        mimic = described[model.names[i]].find("mimic")
        master = model.names[i] if mimic is None else mimic.get("joint")
        factor = 1.0 if mimic is None else float(mimic.get("multiplier", 1.0))
        expand[model.joints[i].idx_v, arm.joint_names.index(master)] = factor
    out = []
    for row in zip(q, qd, qdd, strict=True):
        at, speed, gain = (expand @ values for values in row)
        at = pin.integrate(model, pin.neutral(model), at)
        out.append(expand.T @ pin.rnea(model, data, at, speed, gain))
    dynamics = [described[name].find("dynamics") for name in arm.joint_names]
    damping, dry = (np.array([float(d.get(k)) for d in dynamics]) for k in ("damping", "friction"))
    return np.array(out) + damping * qd + dry * np.sign(qd)


def test_files_of_every_arm_have_the_model_s_torque_in_mujoco(made_up):
    for name in ARMS:
        model = without_dry(whole(load(name, made_up)))
        motion = states(model.arm)
        found = by_mujoco(export_model(model, "MJCF").text, model.arm, *motion)
        assert most(found - model.torque(*motion)) < 1e-9, name


def test_a_urdf_has_the_torque_that_it_can_hold_in_pinocchio(made_up):
    for name in ARMS:
        model = whole(load(name, made_up))
        exported = export_model(model, "URDF")
        motion = states(model.arm)
        found = by_pinocchio(exported.text, model.arm, *motion)
        assert most(found - held_torque(exported, *motion)) < 1e-9, name
        kept = {"link_weight", "gravity", "link_inertia", "payload"}
        rigid = replace(model, terms=tuple(t for t in model.terms if t.NAME in kept))
        at_rest = (motion[0], 0.0 * motion[0], 0.0 * motion[0])
        assert (
            most(by_pinocchio(exported.text, model.arm, *at_rest) - rigid.torque(*at_rest)) < 1e-9
        )
        left = {part.name for part in exported.left_out}
        assert {"elastic_cable", "joint_spring"} <= left
        assert "rigid bodies" not in left


def test_names_are_escaped_and_massless_links_get_the_least_that_mujoco_takes(made_up):
    arm = load("made_up", made_up)
    odd = tuple(replace(j, name=f'{j.name} <&"{k}') for k, j in enumerate(arm.joints))
    arm = replace(arm, joints=odd, name="a & b")
    rows = physical(arm)
    rows[-1] = 0.0
    model = TorqueModel(arm, (LinkWeight(arm, rows[:, :4], arm.gravity), LinkInertia(arm, rows)))
    exported, motion = export_model(model, "MJCF"), states(arm)
    assert most(by_mujoco(exported.text, arm, *motion) - model.torque(*motion)) < 1e-9
    assert any(arm.body_names[-1] in note for note in exported.notes)
    text = export_model(model, "URDF").text
    assert most(by_pinocchio(text, arm, *motion) - model.torque(*motion)) < 1e-9


def test_the_urdf_of_an_arm_keeps_its_links_meshes_and_frames(made_up, tmp_path):
    model = whole(load("ur5", made_up))
    before = ElementTree.parse(UR5).getroot()
    after = ElementTree.fromstring(export_model(model, "URDF", tmp_path).text)
    links = {link.get("name") for link in after.findall("link")}
    assert {link.get("name") for link in before.findall("link")} <= links
    meshes = [[m.get("filename") for m in robot.iter("mesh")] for robot in (before, after)]
    assert meshes[0] == meshes[1]
    still = replace(model, joint_offset=np.zeros(6))
    poses = []
    for robot in (UR5.read_text(), export_model(still, "URDF", tmp_path).text):
        arm = pin.buildModelFromXML(robot)
        data, q = arm.createData(), states(model.arm)[0][0]
        pin.framesForwardKinematics(arm, data, q)
        base, tip = (data.oMf[arm.getFrameId(name)] for name in ("base_link", "tool0"))
        poses.append((base.inverse() * tip).homogeneous)
    assert most(poses[0] - poses[1]) < 1e-12
