"""The masses in a URDF as the model on trial, beside other errors of it and of the recording."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from robots import PANDA, UR5

from dvrk_gravity import Arm, Recording, TorqueModel, diagnose
from dvrk_gravity.arms import nominal_inertias
from testing.plain_world import PlainWorld

MASS, COM = 1.5, (0.02, 0.05, 0.08)  # kg, m in the last link's frame


@pytest.fixture(scope="module")
def world() -> PlainWorld:
    arm = Arm.load(UR5)
    bare = PlainWorld.of(arm, nominal_inertias(arm))
    return bare.with_payload(arm.body_names[-1], MASS, COM)


@pytest.fixture(scope="module")
def recording(world) -> Recording:
    return world.record(1, 15.0)


def test_a_load_is_found_though_the_file_states_more_damping_than_there_is(
    world, recording, tmp_path
):
    """Many files have one damping throughout, some of it far too large."""
    placeholder = tmp_path / "robot.urdf"
    placeholder.write_text(re.sub('damping="0.0"', 'damping="30.0"', Path(UR5).read_text()))
    assert (world.viscous < 30.0).all()

    first, *others = diagnose(recording, placeholder).findings

    assert first.effect == "payload"
    assert first.parameters["mass"].value == pytest.approx(MASS, rel=0.05)
    for finding in others:
        joint = world.arm.joint_names.index(finding.joints[0])
        if finding.effect == "viscous_friction":
            less = 30.0 - world.viscous[joint]
            assert -finding.parameters["coefficient"].value == pytest.approx(less, rel=0.02)
    assert {finding.effect for finding in others} == {"viscous_friction", "coulomb_friction"}
    assert len(others) == 12


def test_what_a_reading_does_to_other_causes_is_not_told_as_more_of_them(world, recording):
    """A factor reads too much of a payload's torque and of friction's, too."""
    joint, factor = 1, 1.15
    read = recording.effort * np.where(np.arange(6) == joint, factor, 1.0)

    diagnosis = diagnose(replace(recording, effort=read), UR5)

    found = {(finding.effect, finding.joints): finding for finding in diagnosis.findings}
    names = world.arm.joint_names
    scale = found["torque_scale", (names[joint],)].parameters["factor"]
    assert scale.value == pytest.approx(factor, rel=0.01)
    assert found["payload", names[-1:]].parameters["mass"].value == pytest.approx(MASS, rel=0.05)
    dry = found["coulomb_friction", (names[joint],)].parameters["positive"]
    assert dry.value == pytest.approx(world.coulomb[joint], rel=0.05)
    assert len(found) == 14


@pytest.mark.parametrize("joint", [1, 5], ids=["that bears weight", "that bears none"])
def test_an_effort_of_the_wrong_sign_is_told_though_the_file_has_no_friction(world, joint):
    recording = PlainWorld.of(world.arm, nominal_inertias(world.arm)).record(1, 10.0)
    sign = np.where(np.arange(6) == joint, -1.0, 1.0)

    first, *others = diagnose(replace(recording, effort=sign * recording.effort), UR5).findings

    assert first.effect == "wrong_coordinates"
    assert recording.joints[joint] in first.sentence
    assert first.gain.relative > 0.8
    assert len(others) == 12  # as if it had been right


def test_poses_of_an_arm_as_its_file_says_are_nothing_to_explain():
    """Not even at a joint on which nothing weighs, where the file has no error at all."""
    random = np.random.default_rng(0)
    q = random.uniform(-1.5, 1.5, (80, 6))
    effort = TorqueModel.stated(UR5).torque(q) + 0.05 * random.normal(size=q.shape)

    found = diagnose(Recording(Arm.load(UR5).joint_names, None, q, effort=effort), UR5)

    assert found.verdict == "nothing_to_explain"


def test_joints_that_no_recording_holds_are_held_and_a_load_is_found_all_the_same():
    """A Panda's fingers; their masses are the hand's."""
    arm = Arm.load(f"{PANDA}#panda_hand")
    bare = PlainWorld.of(arm, nominal_inertias(arm))
    recording = bare.with_payload(arm.body_names[-1], 0.8, (0.02, 0.0, 0.2)).record(1, 12.0)

    diagnosis = diagnose(recording, PANDA)

    load = next(found for found in diagnosis.findings if found.effect == "payload")
    assert load.joints == arm.joint_names[-1:]
    assert load.parameters["mass"].value == pytest.approx(0.8, rel=0.05)
    assert set(diagnosis.before) == set(arm.joint_names)
