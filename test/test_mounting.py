"""An arm on a wall or a ceiling, and a URDF that has it stand upright: weight and friction tell."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest
import yaml
from test_arms_dynamics import UR5

from dvrk_gravity.arms import Arm
from dvrk_gravity.arms.tree import nominal_inertias
from dvrk_gravity.diagnosis import diagnose
from dvrk_gravity.diagnosis.load import load
from dvrk_gravity.diagnosis.readings import try_readings
from dvrk_gravity.errors import RecordingError
from dvrk_gravity.identification import evaluate
from dvrk_gravity.identification.effort_unit import in_their_unit
from dvrk_gravity.identification.mounting import mounting
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.recording import Recording
from testing.plain_world import PlainWorld

ARM = Arm.load(UR5)
ALL = "the efforts of all joints have the wrong sign"


def recorded(*base_rpy: float) -> Recording:
    """Return a motion of a UR5 whose base is turned by roll, pitch and yaw, degrees."""
    bare = PlainWorld.of(ARM, nominal_inertias(ARM))
    world = replace(bare, arm=replace(ARM, base_rpy=tuple(np.radians(base_rpy))))
    return replace(world.record(1, 10.0), arm=None)


@pytest.fixture(scope="module")
def upright() -> Recording:
    return recorded(0.0, 0.0, 0.0)


@pytest.fixture(scope="module")
def hanging() -> Recording:
    return recorded(180.0, 0.0, 0.0)


def turned(recording: Recording, *joints: int) -> Recording:
    """Return a recording in which efforts have the wrong sign, of all joints if none is named."""
    sign = np.ones(ARM.n)
    sign[list(joints or range(ARM.n))] = -1.0
    return replace(recording, effort=sign * recording.effort)


@pytest.mark.parametrize("shown", [(180, 0), (0, 90), (-90, 0), (45, 0), (62, 20)])
def test_gravity_is_told_from_the_weight_of_links(shown):
    expected = np.radians(shown)
    found = mounting(recorded(*shown, 0.0), ARM)
    np.testing.assert_allclose(np.abs(found), np.abs(expected), atol=np.radians(4.0))
    assert np.sign(np.round(found, 2)).tolist() == np.sign(expected).tolist()


def test_it_is_refused_with_what_to_write_and_taken_when_that_is_written(hanging, tmp_path):
    for judge in (lambda: evaluate(UR5, hanging), lambda: diagnose(hanging, UR5)):
        with pytest.raises(RecordingError, match=r"base with base_rpy: \[180, 0, 0\] \(degrees\)"):
            judge()
    (tmp_path / "arm.yaml").write_text(yaml.safe_dump({"urdf": str(UR5), "base_rpy": [180, 0, 0]}))
    joints = evaluate(tmp_path / "arm.yaml", hanging).joints
    assert joints["shoulder_lift_joint"].nrmse < 0.2  # friction, of which the file has none


def test_identify_warns_of_it(hanging):
    _, said = in_their_unit(ARM, [hanging])
    assert any("base_rpy: [180, 0, 0]" in line for line in said)


@pytest.mark.parametrize("joints", [(), (1,), (1, 2)])
def test_efforts_of_the_wrong_sign_are_no_other_mounting(upright, joints):
    """They weigh as on the ceiling, but their friction drives."""
    assert mounting(turned(upright, *joints), ARM) is None


def test_wrong_masses_are_no_other_mounting(upright):
    random = np.random.default_rng(0)
    given = {field.name: getattr(ARM, field.name) for field in fields(ARM)}
    for _ in range(50):
        masses = ARM.inertial_parameters * random.lognormal(0.0, 0.7, (ARM.n, 1))
        masses[:, 1:4] += masses[:, :1] * random.normal(0.0, 0.05, (ARM.n, 3))
        assert mounting(upright, Arm(**(given | {"inertial_parameters": masses}))) is None


def test_an_arm_that_hangs_is_not_read_with_efforts_of_the_wrong_sign(upright, hanging):
    """Read so, friction would drive it; where they have the wrong sign, it is the right reading."""

    def said(recording: Recording) -> list[str]:
        motion = load([recording], TorqueModel.stated(ARM)).motion
        return [score.reading.words for score in try_readings(motion) if score.passes]

    assert ALL not in said(hanging)
    assert ALL in said(turned(upright))
