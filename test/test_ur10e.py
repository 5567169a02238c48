"""A real industrial arm: identified from its motors' currents, its gains and its load found."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dvrk_gravity.arms import Arm
from dvrk_gravity.diagnosis import diagnose
from dvrk_gravity.identification import identify
from dvrk_gravity.intake import KnownPayload, drive_gains
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.recording import Recording

PUBLISHED = (14.87, 13.26, 11.13, 10.62, 11.03, 11.47)  # N·m/A, of the UR10e's measurements


@pytest.fixture(scope="module")
def ur10e(measured_data) -> Path:
    folder = measured_data / "ur10e"
    if not folder.is_dir():
        pytest.skip(f"no measurements of a UR10e in {folder}")
    return folder


def test_a_real_industrial_arm_is_identified_and_its_load_found(ur10e, tmp_path):
    arm = Arm.load(ur10e / "ur10e.urdf").with_drive_gains(PUBLISHED)
    fit = identify(ur10e / "ur10e_bare.csv", arm)
    errors = [error.nrmse for error in fit.held_out.values()]
    assert max(errors[:3]) < 0.15
    assert max(errors[3:]) < 0.3
    found = diagnose(ur10e / "ur10e_2805g.csv", fit.model)
    (load,) = found.findings
    assert (load.effect, load.place) == ("payload", "wrist_3_link")
    mass = load.parameters["mass"]
    assert mass.value == pytest.approx(2.805, rel=0.1)
    assert mass.low < 2.805 < mass.high


def test_a_real_load_of_known_mass_tells_the_gains_that_were_published(ur10e):
    files = [Recording.load(ur10e / name) for name in ("ur10e_bare.csv", "ur10e_2805g.csv")]
    arm = Arm.load(ur10e / "ur10e.urdf")
    found = drive_gains(files[:1], files[1:], arm, KnownPayload(2.805))
    assert found.determined[1:].all()
    off = np.abs(found.gain / PUBLISHED - 1.0)
    assert off[found.determined].max() < 0.1


def test_a_real_load_is_found_without_a_model_from_the_same_motion_without_it(ur10e):
    arm = Arm.load(ur10e / "ur10e.urdf").with_drive_gains(PUBLISHED)
    found = diagnose(
        ur10e / "ur10e_2805g.csv", arm=arm, reference=ur10e / "ur10e_bare.csv", known_payload=2.805
    )
    (load,) = found.findings
    mass = load.parameters["mass"]
    assert (load.effect, load.place) == ("payload", "wrist_3_link")
    assert mass.value == pytest.approx(2.805, rel=0.1)
    assert mass.low < 2.805 < mass.high
    assert "the torque scale agrees" in found.payload_check.sentence


@pytest.mark.slow
def test_friction_that_a_urdf_does_not_state_is_found_at_every_real_joint(ur10e, tmp_path):
    stated = TorqueModel.load(ur10e / "ur10e.urdf")
    arm = stated.arm.with_drive_gains(PUBLISHED)

    found = diagnose(ur10e / "ur10e_bare.csv", replace(stated, arm=arm))

    for joint in arm.joint_names:
        dry = {finding.effect for finding in found.findings if finding.joints == (joint,)}
        assert dry & {"coulomb_friction", "presliding_hysteresis"}, joint
        assert found.after[joint] < 0.2 * found.before[joint], joint
    assert all(finding.in_model for finding in found.findings)
    (lacks,) = (finding for finding in found.findings if finding.effect == "payload")
    assert lacks.parameters["mass"].value == pytest.approx(2.2, rel=0.1)  # as the page tells
