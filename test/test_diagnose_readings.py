"""Another reading of a recording is of the same arm: of its limits, and of what it was seen at."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from robots import UR5

from dvrk_gravity.arms import Arm, nominal_inertias
from dvrk_gravity.diagnosis import correct_readings, diagnose, load, try_readings
from dvrk_gravity.identification import identify
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.recording import Recording
from testing.lab_motion import draw_calibration, draw_other
from testing.mujoco_world import MujocoWorld
from testing.plain_world import PlainWorld

pytestmark = pytest.mark.usefixtures("brief_simulation")

ARM = Arm.load("ecm")
TIME = np.arange(0.0, 20.0, 0.01)


def model(along: float = 0.9) -> TorqueModel:
    """Return an ECM whose insertion carries a first moment along it, kg·m."""
    links = {
        "link1": [4.0, 0.1, 0.2, 0.3],
        "link2": [3.0, 0.5, 0.4, 0.3],
        "link3": [2.0, 0.1, 0.2, along],
    }
    weights = {f"link_weight.{name}": weight for name, weight in links.items()}
    return TorqueModel.from_parameters({"arm": "ecm", **weights})


def said_of_insertion(arm: TorqueModel, sign: float) -> list[str]:
    """Return the readings that do better where an arm's insertion is read with a sign."""
    middle, half = 0.5 * (ARM.upper + ARM.lower), 0.5 * (ARM.upper - ARM.lower)
    q = middle + 0.8 * half * np.sin(TIME[:, None] * (0.6 + 0.23 * np.arange(ARM.n)))
    effort = arm.torque(q, np.gradient(q, TIME, axis=0))
    effort[:, 3] += 1e-6 * np.sin(TIME)  # nothing weighs on the roll, but a sensor is not dead
    read = q * [1.0, 1.0, sign, 1.0]
    scores = try_readings(
        load([Recording(ARM.joint_names, TIME, read, None, effort)], model()).motion
    )
    return [score.reading.words for score in scores if "insertion" in score.reading.words]


def test_a_position_that_is_read_with_the_wrong_sign_is_seen():
    assert "the position of insertion has the wrong sign" in said_of_insertion(model(), -1.0)


def test_no_reading_takes_an_arm_beyond_its_limits():
    """A centre of mass that lies nearer is as if the insertion slid the other way: it cannot."""
    assert said_of_insertion(model(along=0.4), 1.0) == []


@pytest.fixture(scope="module")
def world() -> PlainWorld:
    arm = Arm.load(UR5)
    return PlainWorld.of(arm, nominal_inertias(arm))


@pytest.fixture(scope="module")
def calibration(world) -> Recording:
    return world.record(1, 14.0)


@pytest.fixture(scope="module")
def identified(world, calibration, four_folds):
    """Return an arm's recording, and a model that was identified from another motion of it."""
    return world.record(2, 12.0), identify(calibration, world.arm).model


@pytest.mark.parametrize("seen_before", [True, False])
def test_an_effort_of_the_wrong_sign_is_no_friction_that_drives(
    calibration, identified, seen_before
):
    """On a wrist that bears next to nothing, friction is nearly all that the effort is.

    Where the model has not seen the wrist's positions, it does not say enough to tell a sign.
    """
    recording, model = identified
    arm = model.arm
    if seen_before:
        model = identify([calibration, recording], arm).model
    wrist = arm.joint_names.index("wrist_2_joint")
    sign = np.where(np.arange(arm.n) == wrist, -1.0, 1.0)

    found = diagnose(replace(recording, effort=sign * recording.effort), model).findings

    if seen_before:
        assert [finding.place for finding in found] == [
            "the effort of wrist_2_joint has the wrong sign"
        ]
    assert not {finding.effect for finding in found} & {"coulomb_friction", "viscous_friction"}


@pytest.mark.usefixtures("four_folds")
def test_what_a_model_leaves_open_beyond_its_range_is_no_wrong_sign():
    """All of the motion is beyond the calibration's at wrist_roll; with its signs turned it is not.

    That explains the error as well as what the model leaves open of the cable there, and no better.
    """
    world = MujocoWorld.draw("mtmr", 1800)
    calibration = draw_calibration(world.arm, 1800)
    model = identify(world.record(world.truth(calibration), 1800), world.arm).model
    motion, noise = np.random.default_rng([1800, 0]).integers(1 << 30, size=2).tolist()
    other = world.record(world.truth(draw_other(world.arm, motion, calibration), 15.0), noise)
    loaded = load([other], model)
    assert try_readings(loaded.motion)[0].passes, "or there is nothing to tell apart"
    assert correct_readings(loaded, lambda line: None).wrong == ()


@pytest.mark.parametrize("pair", [(4, 5), (3, 4), (0, 2)])
def test_exchanged_efforts_are_named_as_such_where_the_model_is_extrapolated_too(identified, pair):
    """As exchanged positions, or torques that leak, they are explained worse."""
    recording, model = identified
    order = np.arange(model.arm.n)
    order[list(pair)] = pair[::-1]

    found = diagnose(replace(recording, effort=recording.effort[:, order]), model).findings

    names = tuple(model.arm.joint_names[joint] for joint in pair)
    assert [(finding.effect, finding.joints) for finding in found] == [("wrong_coordinates", names)]
    assert found[0].place == f"the efforts of {' and '.join(names)} are exchanged"
