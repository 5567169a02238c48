"""An encoder, a spring, a tilt and a load, hidden in arms that were identified without them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from robots import UR5

from dvrk_gravity import Arm, Recording, TorqueModel, diagnose, evaluate, identify
from dvrk_gravity.arms import build_tree, nominal_inertias
from dvrk_gravity.effects import Payload, State
from dvrk_gravity.simulate import PlantFile
from testing.lab_effects import Setting, hide, left_by
from testing.lab_motion import draw_calibration, draw_other
from testing.mujoco_world import MujocoWorld
from testing.plain_world import PlainWorld

FRICTION, NOISE, BIAS = 0.02, 0.002, 0.004  # of the largest efforts
INSERTION = 2


def identified(name: str, seconds: float):
    """Return an arm by MuJoCo, a model of it, another motion and what the model misses of that."""
    world = MujocoWorld.draw(name, 31)
    calibration = draw_calibration(world.arm, 31)
    model = identify(world.record(world.truth(calibration, 20.0), 1), world.arm, "joint").model
    truth = world.truth(draw_other(world.arm, 7, calibration), seconds)
    return world, model, truth, world.setting(truth, left_by(model, world.record(truth, 2)))


def test_an_encoder_that_reads_too_far_is_found_with_its_size():
    world, model, _, setting = identified("ur5", 14.0)
    hiding = hide(setting, "encoder_scale", np.random.default_rng(1), joint=2, sizes=(5.0, 8.0))
    diagnosis = diagnose(world.record(hiding.truth, 2), model)
    first, factor = diagnosis.findings[0], hiding.hidden.parameters["factor"]
    assert (first.effect, first.joints) == ("encoder_scale", hiding.hidden.joints)
    assert first.parameters["factor"].low <= factor <= first.parameters["factor"].high
    assert first.parameters["factor"].value - 1.0 == pytest.approx(factor - 1.0, rel=0.15)
    joint = model.arm.joint_names.index(first.joints[0])
    known = diagnosis.model.of_readings()["reading.encoder_scale"][joint]
    assert known == pytest.approx(first.parameters["factor"].value)


def sprung(setting: Setting, first: int, second: int, ratio: float, size: float) -> np.ndarray:
    """Return (T, n) torques of a spring, some times what the model leaves at the second joint."""
    row = np.zeros(setting.n)
    row[first], row[second] = 1.0, ratio
    stretch = setting.truth.q @ row
    torque = (stretch - np.quantile(stretch, 0.3))[:, None] * row
    return torque * size / setting.ratio(torque)


@pytest.mark.parametrize("case", [("ur5", 2, 3, 1.0, 10.0), ("mtml", 3, 5, -0.8, 8.0)])
def test_a_spring_is_found_at_its_two_joints_and_the_extended_model_explains_it(case, tmp_path):
    name, first, second, ratio, size = case
    world, model, truth, setting = identified(name, 20.0)
    torque = sprung(setting, first, second, ratio, size)
    recording = world.record(replace(truth, effort=truth.effort + torque), 2)
    diagnosis = diagnose(recording, model)
    best, names = diagnosis.findings[0], world.arm.joint_names
    assert (best.effect, best.joints) == ("joint_spring", (names[first], names[second]))
    assert best.place == ("sum" if ratio > 0.0 else "difference")
    assert best.parameters["ratio"].value == pytest.approx(abs(ratio), rel=0.25)
    diagnosis.model.save(tmp_path / "extended.yaml")
    again = diagnose(recording, TorqueModel.load(tmp_path / "extended.yaml"))
    assert "joint_spring" not in [finding.effect for finding in again.findings]


def test_a_tilt_is_found_though_nothing_showed_what_weighs_on_the_upright_joint():
    """A base that leans, one that leans far, a wall and a ceiling."""
    arm = Arm.load(UR5)
    world = PlainWorld.of(arm, nominal_inertias(arm))
    model = identify(replace(world.record(1, 20.0), arm=None), arm).model
    for roll, pitch in ((0.0, np.radians(4.0)), (0.8, 0.7), (np.pi / 2, 0.0), (np.pi, 0.0)):
        tilted = replace(world, arm=replace(arm, base_rpy=(roll, pitch, 0.0)))
        diagnosis = diagnose(replace(tilted.record(2, 15.0), arm=None), model)
        (found,) = diagnosis.findings
        assert (found.effect, found.in_model) == ("base_tilt", True)
        for name, angle in (("roll", roll), ("pitch", pitch)):
            assert found.parameters[name].value == pytest.approx(angle, abs=0.01)
        other = replace(tilted.record(3, 10.0), arm=None)
        before, after = (evaluate(each, other).joints for each in (model, diagnosis.model))
        assert after["shoulder_lift_joint"].rmse < 0.5 * before["shoulder_lift_joint"].rmse


def slow_motion(name: str, seed: int, speed: float, noise: int, load: Payload | None) -> Recording:
    """Return efforts by Pinocchio's inverse dynamics; beside a load the insertion's have a bias."""
    plant = PlantFile.load(name)
    arm, motion = plant.model.arm, draw_calibration(plant.model.arm, seed)
    motion = replace(motion, frequency=speed * motion.frequency)
    time = np.arange(0.0, 25.0, 0.01)
    q, qd, qdd = motion.at(time)
    tree = build_tree(arm, plant.links, arm.gravity)
    effort = np.array([tree.inverse_dynamics(*sample) for sample in zip(q, qd, qdd, strict=True)])
    effort += FRICTION * arm.effort_limit * np.tanh(qd / 0.01)
    effort += NOISE * arm.effort_limit * np.random.default_rng(noise).standard_normal(effort.shape)
    if load is not None:
        effort += load.torque(State(q, qd, qdd))
        effort[:, INSERTION] += BIAS * arm.effort_limit[INSERTION]
    return Recording(joints=arm.joint_names, position=q, effort=effort, time=time)


def test_a_load_in_slow_motion_is_no_displaced_centre_of_mass_nor_taken_off():
    """Nor is it on the insertion, whose bias some grams far away would explain.

    Its mass is in the interval, though the load is near the frame and only its moment shows.
    """
    for name, seed, speed, mass, place in (
        ("ecm", 2, 0.4, 0.3, (0.03, 0.15, 0.0)), ("ecm", 2, 0.2, 0.3, (0.03, 0.15, 0.0)),
        ("psm", 1, 0.2, 0.2, (0.15, 0.02, 0.0)), ("psm", 2, 0.2, 0.2, (0.15, 0.02, 0.0)),
    ):  # fmt: skip
        arm = Arm.load(name)
        load = Payload(arm, "link2", mass, mass * np.array(place), arm.gravity)
        bare = slow_motion(name, seed, speed, 1, None)
        found = diagnose(slow_motion(name, seed, speed, 2, load), arm=name, reference=bare).findings
        assert [(each.effect, each.joints) for each in found] == [
            ("payload", ("pitch",)), ("torque_offset", ("insertion",)),
        ]  # fmt: skip
        weighed = found[0].parameters["mass"]
        assert weighed.low <= mass <= weighed.high
