"""A model of wrong efforts or times predicts them well: what is known otherwise contradicts it."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from robots import PANDA, UR5

from dvrk_gravity.arms import Arm, nominal_inertias
from dvrk_gravity.identification import (
    Fit,
    HeldWeight,
    held_weights,
    identify,
    missing_weights,
)
from dvrk_gravity.model import stated_weight
from dvrk_gravity.planning import Multisine
from dvrk_gravity.recording import Recording
from dvrk_gravity.simulate import PlantFile, SimulatedArm, record_motion
from testing.plain_world import PlainWorld
from testing.posed_arms import ur5
from testing.world import COARSE

pytestmark = pytest.mark.usefixtures("four_folds")

FILES = {"ur5": str(UR5), "panda": f"{PANDA}#panda_hand"}
LIFT, ELBOW = 1, 2  # of the UR5
FEW = ["coulomb_friction", "viscous_friction"]
POOR = "do_not_compensate"


@cache
def recorded(name: str = "ur5", masses: tuple[float, float] = (1.0, 1.0), load: float = 0.0):
    """Return a motion of an arm whose links weigh other parts of what its file says."""
    arm = Arm.load(FILES[name])
    links = nominal_inertias(arm)
    part = np.random.default_rng(3).uniform(*masses, len(links))
    drawn = {
        body: pin.Inertia(factor * link.mass, link.lever, factor * link.inertia)
        for (body, link), factor in zip(links.items(), part, strict=True)
    }
    world = PlainWorld.of(arm, drawn)
    if load:
        world = world.with_payload(arm.body_names[-1], load, (0.02, 0.05, 0.08))
    return world.record(1, 15.0)


def fitted(effort=None, recording: Recording | None = None, arm: Arm | str = UR5) -> Fit:
    recording = recorded() if recording is None else recording
    return identify(replace(recording, effort=recording.effort if effort is None else effort),
                    arm, effects=FEW)  # fmt: skip


def poor(fit: Fit) -> set[str]:
    return {name for name, verdict in fit.verdict.joints.items() if verdict.level == POOR}


@pytest.mark.parametrize("name", FILES)
def test_the_weight_that_a_file_states_is_what_pinocchio_makes_of_it(name):
    arm, whole = Arm.load(FILES[name]), pin.buildModelFromUrdf(FILES[name].partition("#")[0])
    for q in np.random.default_rng(0).uniform(-1.5, 1.5, (5, arm.n)):
        expected = pin.computeGeneralizedGravity(
            whole, whole.createData(), np.append(q, np.zeros(whole.nq - arm.n))
        )
        np.testing.assert_allclose(stated_weight(arm, q), expected[: arm.n], atol=1e-9)


@pytest.mark.parametrize(
    ("name", "masses", "load"),
    [("ur5", (0.6, 0.8), 0.0), ("ur5", (1.2, 1.4), 0.0), ("ur5", (0.6, 1.4), 0.0),
     ("ur5", (1.0, 1.0), 4.0), ("panda", (0.6, 1.4), 0.0), ("panda", (1.0, 1.0), 3.0)],
)  # fmt: skip
def test_masses_that_are_rough_and_a_load_keep_a_good_model(name, masses, load):
    fit = fitted(None, recorded(name, masses, load), FILES[name])
    assert fit.verdict.level == "good", fit.verdict.reason
    assert fit.verdict.findings == ()


@pytest.mark.parametrize("factor", [0.001, 0.3, 3.0, 10.0])
def test_efforts_of_another_scale_are_named_by_their_factor(factor):
    fit = fitted(factor * recorded().effort)
    assert fit.model.verdict == POOR
    (line,) = fit.verdict.findings
    assert line.startswith(
        f"efforts of shoulder_lift_joint, elbow_joint are {factor:g} times what the masses"
    )
    assert "\n" not in line
    assert fit.to_json()["verdict"]["findings"] == [line]


@pytest.mark.parametrize(("joint", "factor"), [(ELBOW, 0.3), (LIFT, 3.0), (LIFT, -1.0)])
def test_a_joint_of_another_scale_is_named_alone(joint, factor):
    effort = recorded().effort.copy()
    effort[:, joint] *= factor
    fit = fitted(effort)
    name = fit.model.arm.joint_names[joint]
    assert poor(fit) == {name}
    (line,) = fit.verdict.findings
    said = float(re.match(rf"efforts of {name} are (\S+) times", line)[1])
    assert said == pytest.approx(factor, rel=0.1)
    assert ("a wrong sign" in line) == (factor < 0.0)


def test_efforts_that_are_exchanged_are_named():
    effort = recorded().effort.copy()
    effort[:, [LIFT, ELBOW]] = effort[:, [ELBOW, LIFT]]
    fit = fitted(effort)
    assert {"shoulder_lift_joint", "elbow_joint"} <= poor(fit)
    (line,) = fit.verdict.findings
    assert "the efforts of shoulder_lift_joint and elbow_joint look exchanged" in line


@pytest.mark.parametrize("left", [0.0, 0.05])
def test_efforts_without_gravity_are_said_to_be_so_joint_by_joint(left):
    recording = recorded()
    weight = stated_weight(Arm.load(UR5), recording.position)
    fit = fitted(recording.effort - (1.0 - left) * weight)
    assert poor(fit) == {"shoulder_lift_joint", "elbow_joint"}
    (line,) = fit.verdict.findings
    assert line.startswith("gravity is not in the efforts of shoulder_lift_joint (")
    assert "elbow_joint (" in line
    assert "effort_has_gravity: {read: false}" in line


@pytest.mark.parametrize("size", [0.01, 0.001])
def test_efforts_that_are_noise_make_no_joint_usable(size):
    """Found: an error below 1 % of the effort limit counted as none, whatever was predicted."""
    recording = recorded()
    noise = np.random.default_rng(0).normal(size=recording.effort.shape)
    fit = fitted(size * noise * Arm.load(UR5).effort_limit)
    assert poor(fit) == set(recording.joints)
    assert all(error.r2 < 0.1 for error in fit.held_out.values())
    assert "noise" in fit.verdict.findings[0]


@pytest.mark.parametrize(("factor", "times"), [(0.75, 1.3), (2.0, 2)])
def test_a_wrong_clock_is_named_before_all_else_and_no_such_model_is_used(factor, times):
    """It is as wrong on data held out: velocities that were measured contradict it."""
    recording = recorded()
    clock = replace(recording, time=factor * recording.time)
    fit = fitted(recording=replace(clock, velocity=recording.velocity))
    assert poor(fit) == set(recording.joints)
    assert fit.verdict.findings[0] == (
        f"velocity is {factor:g} times the differentiated position at all joints: the clock, or "
        f"all velocities, are wrong by a factor of {times:g}"
    )
    assert "clock" in fit.verdict.record


def placeholder(folder: Path, mass: float) -> str:
    text = re.sub(r'<mass value="[^"]*"', f'<mass value="{mass}"', Path(UR5).read_text())
    (folder / "robot.urdf").write_text(text)
    return str(folder / "robot.urdf")


def test_masses_that_stand_in_for_some_do_not_veto_what_is_said_to_be_in_newton_metres(tmp_path):
    file = placeholder(tmp_path, 0.1)
    doubted = fitted(arm=file)
    assert doubted.verdict.level == POOR
    assert all("--effort-unit N·m" in line for line in doubted.verdict.findings)

    believed = fitted(arm=Arm.load(file).with_effort_unit("N·m"))

    assert (believed.verdict.level, believed.verdict.findings) == ("good", ())


def test_gravity_that_is_not_there_is_told_whatever_the_masses_are(tmp_path):
    arm = Arm.load(placeholder(tmp_path, 1.0)).with_effort_unit("N·m")
    weight = stated_weight(Arm.load(UR5), recorded().position)
    fit = fitted(recorded().effort - weight, arm=arm)
    assert fit.verdict.level != "good"
    assert fit.verdict.findings[0].startswith("gravity is not in the efforts")


def test_no_masses_say_nothing_against_a_model(tmp_path):
    fit = fitted(arm=placeholder(tmp_path, 0.0))
    assert (fit.verdict.level, fit.verdict.findings) == ("good", ())


def test_a_unit_that_is_stated_is_no_contradiction():
    fit = fitted(0.08 * recorded().effort, arm=Arm.load(UR5).with_effort_unit("A"))
    assert (fit.verdict.level, fit.verdict.findings) == ("good", ())


@pytest.mark.parametrize("name", ["psm", "ecm", "mtmr_28002"])
def test_plausible_masses_of_a_shipped_arm_tell_that_gravity_is_not_there(name):
    plant = PlantFile.load(name)
    arm = SimulatedArm(plant.plant(), plant.sensors, 1, dt=COARSE)
    recording = record_motion(arm, Multisine.draw(plant.model.arm, 1), 15.0)
    whole = identify(recording, plant.model.arm, "joint", FEW)
    assert whole.verdict.findings == ()

    held = plant.model.torque(recording.position)
    fit = identify(
        replace(recording, effort=recording.effort - held), plant.model.arm, "joint", FEW
    )

    assert fit.verdict.level == POOR
    assert fit.verdict.findings[0].startswith("gravity is not in the efforts of")


@pytest.mark.parametrize(
    ("gone", "sure"),
    [(("shoulder_pitch",), True), (("wrist_pitch",), False), (("wrist_pitch", "wrist_yaw"), False)],
)
def test_plausible_masses_forbid_a_model_where_most_of_the_weight_is_missing(gone, sure):
    """Found: one joint of several is no majority, and carries three quarters of the weight."""
    arm = Arm.load("mtmr")
    weight = {"shoulder_pitch": 0.61, "elbow_pitch": 0.2, "wrist_pitch": 0.09, "wrist_yaw": 0.01}
    weights = [
        HeldWeight(joint, 0.0 if joint in gone else 1.0, 0.01, size, stated=False, believed=True)
        for joint, size in weight.items()
    ]
    (found,) = missing_weights(weights, arm)
    assert found.joints == gone
    assert (found.level == POOR) == sure


def test_poses_are_judged_by_the_masses_as_motions_are():
    posed = ur5()
    recording = posed.record(1, 120)
    effort = recording.effort.copy()
    assert identify(recording, posed.arm).verdict.findings == ()

    effort[:, recording.joints.index("elbow_joint")] *= 0.3
    (line,) = identify(replace(recording, effort=effort), posed.arm).verdict.findings
    assert line.startswith("efforts of elbow_joint are 0.3")

    noise = np.random.default_rng(0).normal(size=effort.shape)
    judged = identify(replace(recording, effort=noise), posed.arm)
    assert poor(judged) == set(recording.joints)
    assert "noise" in judged.verdict.findings[0]


def test_a_load_that_no_such_arm_lifts_explains_no_factor():
    """The same sizes as a load's, of a wrong scale: three times all efforts, and not of a load."""
    fit = fitted(3.0 * recorded("panda").effort, recorded("panda"), FILES["panda"])
    assert fit.verdict.level == POOR
    (line,) = fit.verdict.findings
    assert "are 3 times what the masses" in line


REAL = {
    "ur10e/ur10e_bare.csv": ("ur10e/ur10e.urdf", 1.1, 1.4),
    "ur10e/ur10e_2805g.csv": ("ur10e/ur10e.urdf", 1.4, 1.9),
    "psm/psm_one_105g_insertion.csv": ("psm", 0.2, 1.2),
    "mtmr28002_static_pos.csv": ("mtmr", 0.2, 1.7),
}


@pytest.mark.parametrize("file", REAL)
def test_real_efforts_are_within_what_the_masses_of_such_arms_weigh(measured_data, file):
    """With the published gains of the UR10e; its file has the masses of a UR10."""
    name, least, most = REAL[file]
    if not (measured_data / file).exists():
        pytest.skip(f"no {file} in {measured_data}")
    arm = Arm.load(measured_data / name if name.endswith(".urdf") else name)
    if name.endswith(".urdf"):
        arm = arm.with_drive_gains((14.87, 13.26, 11.13, 10.62, 11.03, 11.47))
    fit = identify(measured_data / file, arm, "actuator" if name == "psm" else "joint")
    assert fit.verdict.findings == ()
    q = np.concatenate([trace.position for trace in fit.traces])
    q = arm.joint_position(q) if fit.coordinates == "actuator" else q
    ratios = [weight.ratio for weight in held_weights(fit.model, q, fit.holding)]
    assert len(ratios) >= 3
    assert least < min(ratios)
    assert max(ratios) < most
