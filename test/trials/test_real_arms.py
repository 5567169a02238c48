"""What is found on measured data of real arms: loads, friction, another day, a console's file."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from known_poses import ARM, RECORDED

from dvrk_gravity.arms import Arm
from dvrk_gravity.diagnosis import diagnose
from dvrk_gravity.identification import Fit, fit_static, identify, predict_unseen, read_poses
from dvrk_gravity.recording import Recording

GAINS = (14.87, 13.26, 11.13, 10.62, 11.03, 11.47)  # N·m/A, published of the UR10e


@pytest.fixture(scope="module")
def ur10e(measured_data):
    folder = measured_data / "ur10e"
    if not folder.is_dir():
        pytest.skip(f"no measurements of a UR10e in {folder}")
    return folder


@pytest.mark.parametrize("by_model", [True, False])
def test_a_load_on_an_industrial_arm_is_found_by_a_model_or_from_the_same_motion(ur10e, by_model):
    arm = Arm.load(ur10e / "ur10e.urdf").with_drive_gains(GAINS)
    bare, loaded = ur10e / "ur10e_bare.csv", ur10e / "ur10e_2805g.csv"
    if by_model:
        found = diagnose(loaded, identify(bare, arm).model)
    else:
        found = diagnose(loaded, arm=arm, reference=bare, known_payload=2.805)
    (load,) = found.findings
    assert (load.effect, load.place) == ("payload", "wrist_3_link")
    mass = load.parameters["mass"]
    assert mass.value == pytest.approx(2.805, rel=0.1)
    assert mass.low < 2.805 < mass.high


@cache
def psm(folder) -> Fit:
    return identify(folder / "psm" / "psm_one.csv", "psm", "actuator")


def test_the_same_motion_of_a_patient_side_arm_on_another_day_is_quiet(measured_data):
    """Though its wrist rubs by a third more then."""
    path = measured_data / "psm" / "psm_one_bare.csv"
    diagnosis = diagnose(path, psm(measured_data).model, coordinates="actuator")
    assert (diagnosis.verdict, diagnosis.findings) == ("nothing_to_explain", ())
    # Its coordinates read wrongly would take the jaw where the model says nothing.
    (finding,) = diagnose(path, psm(measured_data).model).findings
    assert finding.effect == "wrong_coordinates"


@pytest.mark.parametrize("reference", [None, "psm_one_bare", "psm_one"])
def test_a_weight_on_a_patient_side_arm_is_weighed_and_placed(measured_data, reference):
    """105 g, 535 mm from the remote centre along the insertion, 24 mm beside it, on its rail."""
    folder = measured_data / "psm"
    known = {"model": psm(measured_data).model}
    if reference:
        known = {"arm": "psm", "reference": folder / f"{reference}.csv"}
    loaded = folder / "psm_one_105g_insertion.csv"
    first = diagnose(loaded, coordinates="actuator", **known).findings[0]
    assert (first.effect, first.place) == ("payload", "link2")
    for name, truth in (("mass", 0.105), ("y", 0.535), ("x", 0.024)):
        assert first.parameters[name].low <= truth <= first.parameters[name].high


def test_poses_invent_no_torque_outside_their_range(measured_data, tmp_path):
    """Joints 1 and 7 were never posed; the others through a part of their range."""
    recordings = [Recording.load(measured_data / name) for name in RECORDED]
    poses, _ = read_poses(recordings, ARM, "joint")
    fit = fit_static(recordings, ARM)
    residual = poses.effort - fit.model.torque(poses.q, direction=poses.direction)
    # The median's own spread: the poses at which the arm was stuck are in the data.
    noise = 1.4826 * np.median(np.abs(residual), axis=0)
    assert (noise < [0.008, 0.02, 0.015, 0.009, 0.006, 0.005, 0.001]).all(), noise
    q = np.random.default_rng(2).uniform(ARM.lower, ARM.upper, (100_000, 7))
    for direction in (None, np.ones(q.shape), -np.ones(q.shape)):
        torque = fit.model.torque(q, direction=direction)
        assert (torque <= poses.effort.max(axis=0) + 1.05 * noise).all()
        assert (torque >= poses.effort.min(axis=0) - 1.05 * noise).all()
    thinned = poses.rows(np.arange(len(poses)) % 2 == 0)
    stuck = predict_unseen(thinned, np.arange(len(thinned)) % 25 == 0, ARM)
    assert np.abs(stuck[:, 4]).max() < 0.1
