"""A base that was level when an arm was identified, and leans: what its shaft bears shows then."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from robots import UR5

from dvrk_gravity import Arm, diagnose, evaluate, identify
from dvrk_gravity.arms import nominal_inertias
from dvrk_gravity.effects import base_tilt
from dvrk_gravity.model import TorqueModel
from testing.plain_world import PlainWorld

TILT = np.radians(4.0)


@pytest.fixture(scope="module")
def world() -> PlainWorld:
    arm = Arm.load(UR5)
    return PlainWorld.of(arm, nominal_inertias(arm))


@pytest.fixture(scope="module")
def model(world) -> TorqueModel:
    return identify(replace(world.record(1, 20.0), arm=None), world.arm).model


def leaning(world: PlainWorld, roll: float, pitch: float) -> PlainWorld:
    return replace(world, arm=replace(world.arm, base_rpy=(roll, pitch, 0.0)))


@pytest.mark.usefixtures("four_folds")
def test_a_tilt_is_told_alone_though_nothing_showed_what_weighs_on_the_upright_joint(world, model):
    tilted = leaning(world, 0.0, TILT)

    diagnosis = diagnose(replace(tilted.record(2, 15.0), arm=None), model)

    (found,) = diagnosis.findings
    assert (found.effect, found.in_model) == ("base_tilt", True)
    assert found.parameters["pitch"].value == pytest.approx(TILT, rel=0.1)
    other = replace(tilted.record(3, 10.0), arm=None)
    before, after = (evaluate(each, other).joints for each in (model, diagnosis.model))
    assert after["shoulder_pan_joint"].rmse < 0.4 * before["shoulder_pan_joint"].rmse


@pytest.mark.usefixtures("four_folds")
def test_a_large_tilt_is_told_as_exactly(world, model):
    tilt = {"roll": 0.8, "pitch": 0.7}

    diagnosis = diagnose(replace(leaning(world, **tilt).record(2, 15.0), arm=None), model)

    (found,) = diagnosis.findings
    assert (found.effect, found.in_model) == ("base_tilt", True)
    for name, angle in tilt.items():
        estimate = found.parameters[name]
        assert estimate.value == pytest.approx(angle, abs=0.005)
        assert estimate.low < angle < estimate.high


@pytest.mark.usefixtures("four_folds")
@pytest.mark.parametrize("roll", [np.pi / 2, np.pi], ids=["wall", "ceiling"])
def test_an_arm_that_hangs_from_a_wall_or_a_ceiling_is_told_so(world, model, roll):
    tilt = {"roll": roll, "pitch": 0.0}

    diagnosis = diagnose(replace(leaning(world, **tilt).record(2, 15.0), arm=None), model)

    (found,) = diagnosis.findings
    assert (found.effect, found.in_model) == ("base_tilt", True)
    for name, angle in tilt.items():
        estimate = found.parameters[name]
        assert estimate.value == pytest.approx(angle, abs=0.01)
        assert estimate.low < angle < estimate.high
    expected = leaning(world, **tilt).arm.gravity
    np.testing.assert_allclose(diagnosis.model.gravity, expected, atol=0.1)


@pytest.mark.parametrize("before", [(0.0, 0.0, -1.0), (0.3, -0.8, 0.5)])
def test_roll_and_pitch_take_gravity_from_one_direction_to_another(before):
    random = np.random.default_rng(0)
    for _ in range(200):
        turn = pin.rpy.rpyToMatrix(*random.uniform(-np.pi, np.pi, 2), 0.0)
        after = turn.T @ np.array(before)

        roll, pitch = base_tilt._angles(np.array(before), after)

        np.testing.assert_allclose(
            pin.rpy.rpyToMatrix(roll, pitch, 0.0).T @ np.array(before), after, atol=1e-6
        )
        assert abs(pitch) <= np.pi
