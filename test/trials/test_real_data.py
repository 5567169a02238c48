"""Measured data of real arms: published figures, once each; more of them in trials/."""

from __future__ import annotations

import numpy as np
import pytest
from known_poses import ARM, RECORDED

from dvrk_gravity.arms import Arm
from dvrk_gravity.estimation import slabs
from dvrk_gravity.identification import held_weights, identify, predict_unseen, read_poses
from dvrk_gravity.observation import KnownPayload, drive_gains
from dvrk_gravity.recording import Recording

GAINS = (14.87, 13.26, 11.13, 10.62, 11.03, 11.47)  # N·m/A, published of the UR10e
# Of a PSM on another trajectory than the fit's, |e|/|tau| by motor: the physically consistent model
# of the authors of WPI-AIM/dvrk_dynamics_identification.
PSM = (0.093, 0.178, 0.191, 0.134, 0.239, 0.213, 0.264)


def test_phases_of_a_master_arm_s_motion_that_were_held_out_are_predicted(measured_data):
    """Best published errors on another trajectory: .077 .149 .170 .209 .259 .234 .339."""
    recording = Recording.load(measured_data / "mtm_dynamic_30s_200hz.csv")
    fit = identify([recording], ARM, bias_is="torque")
    assert fit.coordinates == "actuator"
    assert "11.6" in fit.validation  # the period of its motion, s
    errors = [error.nrmse for error in fit.held_out.values()]
    limits = [0.08, 0.20, 0.16, 0.16, 0.25, 0.24, 0.33]
    assert all(error < limit for error, limit in zip(errors, limits, strict=True)), errors
    levels = {name: verdict.level for name, verdict in fit.verdict.joints.items()}
    assert levels.pop("outer_yaw") == "usable"  # its range was not covered
    assert set(levels.values()) == {"good"}
    # What else constants of the joints may be: cables at the wrist, and weight looks like them.
    moving = {name for name, each in fit.constants.items() if each.moves}
    assert {"elbow_pitch", "wrist_yaw"} < moving
    assert not fit.constants["elbow_pitch"].determined
    assert fit.constants["wrist_yaw"].determined


def test_phases_of_a_patient_side_arm_s_motion_are_predicted_better_than_published(measured_data):
    fit = identify(measured_data / "psm" / "psm_one.csv", "psm", "actuator")
    for (motor, error), published in zip(fit.held_out.items(), PSM, strict=True):
        assert error.nrmse < published, motor


def test_an_industrial_arm_is_identified_and_a_load_of_known_mass_determines_its_gains(
    measured_data,
):
    folder = measured_data / "ur10e"
    if not folder.is_dir():
        pytest.skip(f"no measurements of a UR10e in {folder}")
    arm = Arm.load(folder / "ur10e.urdf")
    fit = identify(folder / "ur10e_bare.csv", arm.with_drive_gains(GAINS))
    errors = [error.nrmse for error in fit.held_out.values()]
    assert max(errors[:3]) < 0.15
    assert max(errors[3:]) < 0.3
    assert fit.verdict.findings == ()
    # Its file has the masses of a UR10.
    q = np.concatenate([trace.position for trace in fit.traces])
    ratios = [weight.ratio for weight in held_weights(fit.model, q, fit.holding)]
    assert len(ratios) >= 3
    assert 1.1 < min(ratios) <= max(ratios) < 1.4
    files = [Recording.load(folder / name) for name in ("ur10e_bare.csv", "ur10e_2805g.csv")]
    found = drive_gains(files[:1], files[1:], arm, KnownPayload(2.805))
    assert found.determined[1:].all()
    assert np.abs(found.gain / GAINS - 1.0)[found.determined].max() < 0.1


def test_static_poses_are_predicted_at_positions_never_seen(measured_data):
    recordings = [Recording.load(measured_data / name) for name in RECORDED]
    poses, _ = read_poses(recordings, ARM, "joint")
    unseen = slabs(poses.q[:, 4]) == 2
    predicted = predict_unseen(poses, unseen, ARM)
    rmse = np.sqrt(np.mean((poses.effort[unseen] - predicted) ** 2, axis=0))
    # The last two are half of what a refit of the console's columns leaves: 14 and 7 mN·m.
    assert (rmse[1:6] < [0.020, 0.016, 0.009, 0.011, 0.005]).all(), rmse
