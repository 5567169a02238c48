"""An arm is data: made-up chains and arms from URDFs are identified, diagnosed and compensated.

The simulated arms move by Pinocchio's dynamics of links and friction that no effect of the package
computes.
"""

from __future__ import annotations

from dataclasses import replace

import fitted
import numpy as np
import pytest
from fitted import FEW, Identified
from robots import UR5

from dvrk_gravity.arms import Arm
from dvrk_gravity.compensate import Settings
from dvrk_gravity.diagnosis import diagnose
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.identification import evaluate, identify
from dvrk_gravity.model import TorqueModel, fitted_effects
from dvrk_gravity.recording import Recording
from dvrk_gravity.simulate import PlantFile
from testing.mujoco_arms import KINOVA
from testing.plain_world import NOISE

LAST, SLIDES = "link4", 2  # of the chain
MASS, COM = 0.3, (0.02, -0.01, 0.05)  # kg, m in the last link's frame


@pytest.fixture(scope="module")
def known() -> Identified:
    return fitted.chain()


@pytest.fixture(scope="module")
def model(known, tmp_path_factory) -> TorqueModel:
    """What the model's file holds."""
    file = tmp_path_factory.mktemp("chain") / "model.yaml"
    known.fit.model.save(file)
    return TorqueModel.load(file)


def error_beyond_noise(known: Identified, model: TorqueModel, recording: Recording) -> np.ndarray:
    """(n,) RMS error at the joints as a part of the noise of the measured effort."""
    arm = known.arm
    noise = arm.joint_effort(np.diag(NOISE * arm.actuator_effort_limit))
    found = evaluate(model, [recording], "joint").joints
    rmse = np.array([found[name].rmse for name in arm.joint_names])
    return rmse / np.linalg.norm(noise, axis=0)


def test_an_identified_arm_is_fit_to_be_compensated_and_names_its_own_bodies(known):
    fit = known.fit
    doubtful = {name for name, each in fit.verdict.joints.items() if each.level != "good"}
    assert fit.verdict.level in ("good", "usable")
    assert all(abs(fit.constants[name].most) > fit.constants[name].least for name in doubtful)
    names = [parameter.name for parameter in known.fit.parameters]
    assert not any("beta" in name or "outer_yaw" in name for name in names)
    assert any(LAST in name for name in names)


def test_friction_comes_out_with_the_unit_of_its_joint(known):
    found = {parameter.name: parameter for parameter in known.fit.parameters}
    for joint, coulomb, viscous in zip(
        known.arm.joints, known.world.coulomb, known.world.viscous, strict=True
    ):
        slide = joint.kind == "prismatic"
        dry = found[f"coulomb_friction.joint[{joint.name}]"]
        damping = found[f"viscous_friction.joint[{joint.name}]"]
        assert (dry.unit, damping.unit) == (("N", "N·s/m") if slide else ("N·m", "N·m·s/rad"))
        assert dry.value == pytest.approx(coulomb, rel=0.1), joint.name
        assert damping.value == pytest.approx(viscous, rel=0.2), joint.name


def test_another_motion_is_predicted_and_nothing_is_found_in_it(known, model):
    recording = known.world.record(2, 16.0)
    assert (error_beyond_noise(known, model, recording) < 1.0).all()
    assert diagnose(recording, model).verdict == "nothing_to_explain"


def test_a_hidden_payload_is_found_weighed_and_taken_into_the_model(known, model, tmp_path):
    loaded = known.world.with_payload(LAST, MASS, COM)
    found = diagnose(loaded.record(2, 14.0), model)
    payload = found.findings[0]
    assert (payload.effect, payload.joints) == ("payload", (known.arm.joint_names[-1],))
    assert payload.parameters["mass"].value == pytest.approx(MASS, rel=0.05)
    # Across the last joint's axis that joint weighs it; along it the arm before does, whose
    # torques are known less well.
    for axis, coordinate, within in zip("xyz", COM, (0.002, 0.002, 0.01), strict=True):
        moment = payload.parameters[f"first_moment_{axis}"].value
        assert moment == pytest.approx(MASS * coordinate, abs=within), axis
    found.model.save(tmp_path / "extended.yaml")
    extended = TorqueModel.load(tmp_path / "extended.yaml")
    other = loaded.record(3, 8.0)
    assert error_beyond_noise(known, model, other).max() > 3.0
    assert error_beyond_noise(known, extended, other).max() < 1.5


def test_added_dry_friction_is_found_at_its_joint(known, model):
    added = float(known.world.coulomb[SLIDES])
    found = diagnose(known.world.with_friction(SLIDES, added).record(2, 12.0), model)
    friction = found.findings[0]
    assert (friction.effect, friction.joints) == (
        "coulomb_friction", (known.arm.joint_names[SLIDES],),
    )  # fmt: skip
    for way in ("positive", "negative"):
        assert friction.parameters[way].value == pytest.approx(added, rel=0.1)
        assert friction.parameters[way].unit == "N"


def test_a_model_of_any_arm_moves_in_the_simulator_and_balances(known, model, tmp_path):
    model.save(tmp_path / "model.yaml")
    plant = PlantFile.load(tmp_path / "model.yaml").plant()
    plant.reset(np.mean(known.arm.range, axis=0))
    start = plant.q.copy()
    for _ in range(200):
        plant.step(model.torque(plant.q), dt=1e-3)
    np.testing.assert_allclose(plant.q, start, atol=1e-6)
    for _ in range(200):
        plant.step(np.zeros(known.arm.n), dt=1e-3)
    assert np.abs(plant.q - start).max() > 0.01


def test_joints_that_turn_without_an_end_are_fitted_with_the_same_effects():
    endless = Arm.load(KINOVA)
    assert np.isinf(endless.upper).any()
    assert fitted_effects(endless) == fitted_effects(Arm.load(UR5))


def test_a_compensator_without_the_weight_of_its_arm_is_refused_in_one_line(known):
    given = {"arm": known.arm.source}
    with pytest.raises(ConfigError, match=r"^link_weight\.\*: got \[\], expected weight of link1"):
        Settings.from_parameters(given)
    assert Settings.from_parameters({**given, "link_weight.link4": (0.5, 0.0, 0.0, 0.02)})


# --- an arm whose joints all slide: its weight is the same everywhere, and all of it known ---

GANTRY = """
<robot name="gantry"><link name="base"/>
<link name="beam"><inertial><mass value="1.5"/><origin xyz="0.05 0.02 0.1"/>
<inertia ixx="0.02" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="hand"><inertial><mass value="1.3"/><origin xyz="0.05 0 0.1"/>
<inertia ixx="0.02" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="lift" type="prismatic"><parent link="base"/><child link="beam"/>
<axis xyz="0 0 1"/><limit lower="0" upper="0.3" effort="{0}" velocity="0.4"/>
<dynamics damping="0.4" friction="0.7"/></joint>
<joint name="slide" type="prismatic"><parent link="beam"/><child link="hand"/>
<origin xyz="0.1 0 0.2" rpy="0.3 0.2 0.1"/><axis xyz="1 1 0"/>
<limit lower="0" upper="0.3" effort="{0}" velocity="0.4"/></joint></robot>
"""


def slid(model: TorqueModel, seed: int) -> Recording:
    random, time = np.random.default_rng(seed), np.arange(2000) / 100.0
    pace = 2.0 * np.pi * random.uniform(0.1, 0.6, (2, 3))
    phase = pace * time[:, None, None] + random.uniform(0.0, 6.0, (2, 3))
    q = 0.15 + 0.04 * np.sin(phase).sum(axis=2)
    qd, qdd = 0.04 * (pace * np.cos(phase)).sum(2), -0.04 * (pace**2 * np.sin(phase)).sum(2)
    effort = model.torque(q, qd, qdd) + 0.02 * random.normal(size=q.shape)
    return Recording(model.arm.joint_names, time, q, qd, effort)


def gantry(folder, limit: int) -> Arm:
    path = folder / f"gantry_{limit}.urdf"
    path.write_text(GANTRY.format(limit))
    return Arm.load(str(path))


def test_a_gantry_is_identified_evaluated_and_diagnosed(tmp_path):
    arm = gantry(tmp_path, 60)
    truth = TorqueModel.from_arm(arm)
    first, second = slid(truth, 0), slid(truth, 1)
    fit = identify(first, arm)
    assert fit.verdict.level == "good"
    fit.model.save(tmp_path / "model.yaml")
    model = TorqueModel.load(tmp_path / "model.yaml")
    assert set(evaluate(model, second).expected) == {"lift", "slide"}
    assert diagnose(second, model).findings == ()
    biased = replace(second, effort=second.effort + np.array([3.0, 0.0]))
    (finding,) = diagnose(biased, model).findings
    assert finding.joints == ("lift",)


def test_an_effort_limit_far_above_the_torques_changes_nothing(tmp_path):
    recording = slid(TorqueModel.from_arm(gantry(tmp_path, 60)), 0)
    tight, wide = (
        identify(recording, gantry(tmp_path, limit), effects=FEW) for limit in (60, 1_000_000)
    )
    assert wide.identifiability.rank == tight.identifiability.rank
    for name, error in tight.held_out.items():
        assert wide.held_out[name].rmse == pytest.approx(error.rmse, rel=0.01)
