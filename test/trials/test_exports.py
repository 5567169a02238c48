"""Models as URDF and MJCF: the same torque in MuJoCo and as an arm, and the cost of the rest."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from exported import by_mujoco, held_torque, load, most, physical, states, whole, without_dry
from made_up_arm import write
from outside_term import OutsideTerm

from dvrk_gravity.arms import Arm, gravity_in_base
from dvrk_gravity.command_line import run
from dvrk_gravity.effects import (
    CoulombFriction,
    ElasticCable,
    JointDynamics,
    LinkInertia,
    LinkWeight,
    Range,
    State,
    base_directions,
    prior_scale,
)
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.exports import export_model
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.simulate import PlantFile

CONVERT = "dvrk_gravity.cli.convert"
ARMS = ("mtmr", "made_up", "ur5")


@pytest.fixture(scope="module")
def made_up(tmp_path_factory) -> Path:
    return write(tmp_path_factory.mktemp("arms"))


def test_an_mjcf_has_the_torque_of_a_whole_model_in_mujoco(made_up):
    for name in ARMS:
        model = without_dry(whole(load(name, made_up)))
        exported = export_model(model, "MJCF")
        motion = states(model.arm)
        assert most(by_mujoco(exported.text, model.arm, *motion) - model.torque(*motion)) < 1e-9, (
            name
        )
        assert exported.left_out == (), name


def test_dry_friction_is_mujocos_frictionloss_at_joints_and_motors(made_up):
    for name in ARMS:
        arm = load(name, made_up)
        model = whole(arm)
        ways = np.sign(np.random.default_rng(5).normal(size=(20, arm.n))) @ arm.actuator_to_joint.T
        q, still = states(arm)[0], np.zeros((20, arm.n))
        ways = 10.0 * arm.scale * ways  # every motor and joint fast, but for those that cancel out
        fast = np.abs(np.hstack([ways, arm.actuator_position(ways)])).min(axis=1) > 0.1
        exported = export_model(model, "MJCF")
        found = by_mujoco(exported.text, arm, q, ways, still) - model.torque(q, ways, still)
        assert fast.any()
        assert most(found[fast]) < 1e-4, name


def test_an_exported_urdf_is_an_arm_with_the_same_torque(made_up, tmp_path):
    for name in ARMS:
        model = whole(load(name, made_up))
        exported = export_model(model, "URDF")
        (tmp_path / "out.urdf").write_text(exported.text)
        again = TorqueModel.load(tmp_path / "out.urdf")
        order = [model.arm.joint_names.index(joint) for joint in again.arm.joint_names]
        motion = tuple(values[:, order] for values in states(model.arm))
        smooth = held_torque(exported, *states(model.arm), dry=False)[:, order]
        assert most(without_dry(again).torque(*motion) - smooth) < 1e-9, name
        assert sorted(again.arm.joint_names) == sorted(model.arm.joint_names)
        saved = TorqueModel.from_parameters(again.parameters(), again.arm)
        np.testing.assert_array_equal(saved.torque(*motion), again.torque(*motion))
        # The file is named as the arm was, and is another one: its masses are those that it states.
        plant = PlantFile.of(again.arm).model
        np.testing.assert_allclose(plant.torque(motion[0]), again.torque(motion[0]), atol=1e-9)
        for joint in again.arm.joints:
            before = model.arm.joints[model.arm.joint_names.index(joint.name)]
            assert (joint.lower, joint.upper) == pytest.approx((before.lower, before.upper))
            assert joint.effort_limit == pytest.approx(before.effort_limit)


def test_parameters_of_no_bodies_become_bodies_with_the_same_torque():
    # What identification finds of an arm: the least parameters, negative masses among them.
    arm = Arm.load("ecm")
    directions = base_directions(arm)
    least = directions @ (directions.T / prior_scale(arm) ** 2) @ physical(arm).ravel()
    model = TorqueModel(arm, (LinkWeight(arm, least.reshape(-1, 10)[:, :4], arm.gravity),
                              LinkInertia(arm, least.reshape(-1, 10))))  # fmt: skip
    exported = export_model(model, "MJCF")
    motion = states(arm)
    assert most(by_mujoco(exported.text, arm, *motion) - model.torque(*motion)) < 1e-9


def test_a_torque_that_no_bodies_have_costs_what_is_said_and_weight_stays():
    arm = Arm.load("ecm")
    rows = physical(arm)
    rows[2, 4:] *= -1.0  # an inertia that is negative
    model = TorqueModel(arm, (LinkWeight(arm, rows[:, :4], arm.gravity), LinkInertia(arm, rows)))
    exported = export_model(model, "MJCF")
    (part,) = exported.left_out
    assert part.name == "rigid bodies"
    q, qd, qdd = states(arm)
    missed = by_mujoco(exported.text, arm, q, qd, 5 * qdd) - model.torque(q, qd, 5 * qdd)
    assert np.sqrt(np.mean(missed**2)) == pytest.approx(np.sqrt(np.mean(part.rms**2)), rel=2.0)
    still = np.zeros_like(q)
    scale = np.sqrt(np.mean(model.torque(q) ** 2, axis=0)).max()
    assert most(by_mujoco(exported.text, arm, q, still, still) - model.torque(q)) < 0.01 * scale


def test_what_is_left_out_costs_its_own_torque():
    arm = Arm.load("ecm")
    rows = physical(arm)
    n = arm.n
    curve = np.zeros((4, n))
    curve[3, 1] = 2.0
    up, down = np.zeros((2, n))
    up[0], down[0] = 0.4, 0.2
    nothing = np.zeros(n)
    model = TorqueModel(arm, (
        LinkWeight(arm, rows[:, :4], arm.gravity), LinkInertia(arm, rows),
        ElasticCable(arm, curve, Range(np.full(n, -0.5), np.full(n, 0.5))),
        CoulombFriction(arm, up, down, nothing, nothing, nothing, nothing, nothing),
    ))  # fmt: skip
    left = {part.name: part.rms for part in export_model(model, "MJCF").left_out}
    assert left["coulomb_friction"] == pytest.approx([0.1, 0.0, 0.0, 0.0])
    # A cubic over ±a less its straight line 3 a^2 x / 5: RMS 2 k a^3 / (5 sqrt 7).
    a = 0.5
    assert left["elastic_cable"][1] == pytest.approx(2.0 * 2.0 * a**3 / (5 * 7**0.5), rel=0.1)
    bare = {part.name: part.rms for part in export_model(model, "URDF").left_out}
    assert bare["elastic_cable"][1] == pytest.approx(2.0 * a**3 / 7**0.5, rel=0.1)


@dataclass(frozen=True, eq=False)
class GasSpring(OutsideTerm):
    """An effect from outside the package: a spring along each joint, and its damper."""

    NAME = "gas_spring"

    stiffness: np.ndarray
    damping: np.ndarray

    def torque(self, state: State) -> np.ndarray:
        damper = 0.0 if state.qd is None else self.damping * state.qd
        return self.stiffness * state.q + damper

    def joint_dynamics(self, arm, q) -> JointDynamics:
        damping = np.array([self.damping, np.zeros(arm.n)])
        return JointDynamics(arm, damping=damping, stiffness=self.stiffness)


def test_an_effect_from_outside_is_exported_by_one_method(made_up):
    arm = load("made_up", made_up)
    stiffness, damping = np.random.default_rng(3).uniform(0.5, 2.0, (2, arm.n))
    model = without_dry(whole(arm))
    model = replace(model, terms=(*model.terms, GasSpring(stiffness, damping)))
    exported, motion = export_model(model, "MJCF"), states(arm)
    assert most(by_mujoco(exported.text, arm, *motion) - model.torque(*motion)) < 1e-9
    assert exported.left_out == ()
    bare = export_model(model, "URDF")
    plain = export_model(replace(model, terms=model.terms[:-1]), "URDF")
    with_it, without = (
        np.array([float(tree.find(f"joint[@name='{name}']/dynamics").get("damping"))
                  for name in arm.joint_names])
        for tree in (ElementTree.fromstring(each.text) for each in (bare, plain))
    )  # fmt: skip
    np.testing.assert_allclose(with_it - without, damping)
    (left,) = (part for part in bare.left_out if part.name == GasSpring.NAME)
    assert "its springs" in left.why
    farthest = np.abs(arm.range).max(axis=0) + np.abs(model.joint_offset)
    np.testing.assert_array_less(left.largest, stiffness * farthest)


def test_convert_writes_a_model_by_the_ending_and_its_cost_as_json(tmp_path, capsys):
    model, report = tmp_path / "model.yaml", tmp_path / "cost.json"
    whole(Arm.load("psm")).save(model)
    for ending, form in (("urdf", "URDF"), ("xml", "MJCF"), ("mjcf", "MJCF")):
        out = tmp_path / f"out.{ending}"
        arguments = [str(model), str(out), "--json", str(report)]
        assert run(CONVERT, arguments) == 0
        content = json.loads(report.read_text())
        assert (content["format"], content["unit"]["insertion"]) == (form, "N")
        written = out.read_text()
        capsys.readouterr()
        assert run(CONVERT, arguments) == 2, "never over a file"
        assert out.name in capsys.readouterr().err
        assert out.read_text() == written
        report.unlink()
    for other in ("out.mjfc", "nowhere/out.urdf"):
        assert run(CONVERT, [str(model), str(tmp_path / other)]) == 2
        error = capsys.readouterr().err
        assert "OUT" in error
        assert "expected" in error
        assert error.count("\n") == 1


def test_a_model_that_no_file_can_hold_is_refused_with_the_way_out():
    model = whole(Arm.load("ecm"))
    for changed, message in (
        (replace(model, arm=model.arm.with_effort_unit("A")), "drive-gains"),
        (replace(model, terms=model.terms[3:]), "no weight and no inertia"),
        (replace(model, terms=(replace(model.terms[0], enabled=False),)), "gravity_enabled"),
    ):
        with pytest.raises(ConfigError, match=message):
            export_model(changed, "URDF")


def test_another_strength_of_gravity_is_an_mjcfs_and_costs_in_a_urdf():
    arm = Arm.load("ecm")
    rows, moon = physical(arm), gravity_in_base(0.1, 0.2) / 6.0
    model = TorqueModel(arm, (LinkWeight(arm, rows[:, :4], moon), LinkInertia(arm, rows)))
    motion = states(arm)
    found = by_mujoco(export_model(model, "MJCF").text, arm, *motion) - model.torque(*motion)
    assert most(found) < 1e-9
    bare = export_model(model, "URDF")
    assert any("9.81" in note for note in bare.notes)
    assert bare.total[2] > 1.0
