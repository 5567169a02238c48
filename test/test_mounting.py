"""An arm on a wall or a ceiling, and a URDF that has it stand upright: its weight shows that."""

from __future__ import annotations

from dataclasses import fields, replace
from functools import cache

import numpy as np
import pytest
import yaml
from robots import UR5

from dvrk_gravity.arms import Arm, gravity_in_base, nominal_inertias
from dvrk_gravity.diagnosis import load, try_readings
from dvrk_gravity.errors import RecordingError
from dvrk_gravity.identification import evaluate
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.observation import Mounting, NominalTorque, in_their_unit, misread, mounting
from dvrk_gravity.recording import Recording
from testing.plain_world import PlainWorld

ARM = Arm.load(UR5)
ALL = "the efforts of all joints have the wrong sign"


@cache
def recorded(roll: float, pitch: float) -> Recording:
    """Return a motion of a UR5 whose base is turned by roll and pitch, degrees."""
    bare = PlainWorld.of(ARM, nominal_inertias(ARM))
    world = replace(bare, arm=replace(ARM, base_rpy=(*np.radians((roll, pitch)), 0.0)))
    return replace(world.record(1, 10.0), arm=None)


@pytest.fixture(scope="module")
def upright() -> Recording:
    return recorded(0.0, 0.0)


@pytest.fixture(scope="module")
def hanging() -> Recording:
    return recorded(180.0, 0.0)


def shown_by(recording: Recording, arm: Arm = ARM) -> Mounting | None:
    """Return how the efforts show a base to be mounted, if otherwise than the file says."""
    nominal = NominalTorque.of(recording, arm)
    assert nominal is not None
    return mounting(nominal)


def turned(recording: Recording, *joints: int) -> Recording:
    """Return a recording in which efforts have the wrong sign, of all joints if none is named."""
    sign = np.ones(ARM.n)
    sign[list(joints or range(ARM.n))] = -1.0
    return replace(recording, effort=sign * recording.effort)


def test_gravity_is_told_from_the_weight_of_links():
    for shown in ((180, 0), (62, 20)):
        expected = np.radians(shown)
        found = shown_by(recorded(*map(float, shown)))
        assert found is not None
        told = gravity_in_base(found.roll, found.pitch)
        angle = np.arccos(told @ gravity_in_base(*expected) / (told @ told))
        assert np.degrees(angle) < 4.0, shown


def test_it_is_refused_with_what_to_write_and_taken_when_that_is_written(hanging, tmp_path):
    with pytest.raises(RecordingError, match=r"base_rpy: \[180, 0, 0\]"):
        evaluate(UR5, hanging)
    _, said = in_their_unit(ARM, [hanging])  # as identify does, which goes on
    assert any("base_rpy: [180, 0, 0]" in note.text for note in said)
    (tmp_path / "arm.yaml").write_text(yaml.safe_dump({"urdf": str(UR5), "base_rpy": [180, 0, 0]}))
    evaluated = evaluate(tmp_path / "arm.yaml", hanging)
    assert not [note for note in evaluated.warnings if "base_rpy" in note.text]
    # What is left is friction, of which the file has none.
    assert evaluated.joints["shoulder_lift_joint"].nrmse < 0.2
    # What a file states itself is believed.
    (tmp_path / "arm.yaml").write_text(yaml.safe_dump({"urdf": str(UR5), "base_rpy": [0, 0, 0]}))
    odd = evaluate(tmp_path / "arm.yaml", hanging).warnings
    assert any("masses" in note.text for note in odd)


def test_a_joint_whose_axis_points_the_other_way_is_named_and_no_mounting(upright, hanging):
    for joint in (1, 3):
        sign = np.where(np.arange(ARM.n) == joint, -1.0, 1.0)
        changed = {name: sign * getattr(upright, name) for name in ("position", "effort")}
        found = misread(NominalTorque.of(replace(upright, velocity=None, **changed), ARM))
        assert (found.joints, found.mounted) == ((ARM.joint_names[joint],), False)
    assert misread(NominalTorque.of(upright, ARM)) is None
    assert misread(NominalTorque.of(hanging, ARM)).mounted


def test_the_angle_of_a_motor_at_one_joint_or_all_is_named_and_a_tilt_is_none(upright):
    for joints in ((1,), (2,), range(ARM.n)):
        geared = np.where(np.isin(range(ARM.n), joints), 2.5, 1.0) * upright.position
        found = misread(NominalTorque.of(replace(upright, velocity=None, position=geared), ARM))
        assert found.joints == tuple(ARM.joint_names[joint] for joint in joints)
    assert misread(NominalTorque.of(recorded(20.0, 15.0), ARM)) is None


def test_efforts_of_the_wrong_sign_are_no_other_mounting(upright):
    """They weigh as on the ceiling, but their friction drives."""
    for joints in ((), (1,), (1, 2)):
        assert shown_by(turned(upright, *joints)) is None


def test_wrong_masses_are_no_other_mounting(upright):
    random = np.random.default_rng(0)
    given = {field.name: getattr(ARM, field.name) for field in fields(ARM)}
    for _ in range(10):
        masses = ARM.inertial_parameters * random.lognormal(0.0, 0.7, (ARM.n, 1))
        masses[:, 1:4] += masses[:, :1] * random.normal(0.0, 0.05, (ARM.n, 3))
        arm = Arm(**(given | {"inertial_parameters": masses}))
        assert shown_by(upright, arm) is None


def test_an_arm_that_hangs_is_not_read_with_efforts_of_the_wrong_sign(upright, hanging):
    """Read so, friction would drive it; where they have the wrong sign, it is the right reading."""

    def said(recording: Recording) -> list[str]:
        motion = load([recording], TorqueModel.from_arm(ARM))
        return [score.reading.words for score in try_readings(motion) if score.passes]

    assert ALL not in said(hanging)
    assert ALL in said(turned(upright))
