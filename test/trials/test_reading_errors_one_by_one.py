"""Wrong readings one by one: found, carried by the extended model, and not found again."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from robots import UR5
from scipy.interpolate import CubicSpline

from dvrk_gravity import Arm, Recording, TorqueModel, diagnose, evaluate
from dvrk_gravity.arms import nominal_inertias
from testing.plain_world import PlainWorld
from testing.world import COARSE, World

Fault = Callable[[Recording], Recording]
ELBOW, SHOULDER = 2, 1
MASTER = World.draw(3, step=COARSE)


@cache
def masters() -> tuple[TorqueModel, Recording, Recording]:
    return MASTER.model(), MASTER.record(3, 4, 14.0, 100.0), MASTER.record(5, 6, 14.0, 100.0)


@cache
def robots() -> tuple[TorqueModel, Recording, Recording]:
    """A UR5 with the masses of its file, and a model that knows its friction, too."""
    arm = Arm.load(str(UR5))
    world = PlainWorld.of(arm, nominal_inertias(arm))
    known = TorqueModel.from_arm(arm).parameters() | {
        "coulomb_friction.joint_positive": tuple(world.coulomb.tolist()),
        "coulomb_friction.joint_negative": tuple(world.coulomb.tolist()),
        "viscous_friction.joint": tuple(world.viscous.tolist()),
    }
    return TorqueModel.from_parameters(known, arm), world.record(1, 14.0), world.record(2, 14.0)


def scaled(recording: Recording, name: str, column: int, factor: float) -> Recording:
    values = getattr(recording, name).copy()
    values[:, column] *= factor
    return replace(recording, **{name: values})


def wrong_scale(recording: Recording) -> Recording:
    return scaled(recording, "effort", ELBOW, 1.3)


def wrong_sign(recording: Recording) -> Recording:
    return scaled(recording, "effort", ELBOW, -1.0)


def late(recording: Recording, delay: float = 0.025) -> Recording:
    then = np.maximum(recording.time - delay, recording.time[0])
    return replace(recording, effort=CubicSpline(recording.time, recording.effort)(then))


def far(recording: Recording) -> Recording:
    recording = scaled(recording, "position", ELBOW, 1.08)
    return scaled(recording, "velocity", ELBOW, 1.08)


def slow(recording: Recording) -> Recording:
    return replace(recording, time=1.5 * recording.time)


def leaking(recording: Recording) -> Recording:
    effort = recording.effort.copy()
    effort[:, SHOULDER] += 0.15 * recording.effort[:, ELBOW]
    return replace(recording, effort=effort)


def judged_twice(
    arm: tuple[TorqueModel, Recording, Recording], fault: Fault, folder
) -> tuple[set[str], TorqueModel]:
    """Diagnose a fault, and again with the extended model; return what was found and that model."""
    model, first, second = arm
    found = diagnose(fault(first), model)
    assert all(finding.in_model for finding in found.findings)
    found.model.save(folder / "extended.yaml")
    extended = TorqueModel.load(folder / "extended.yaml")
    again = diagnose(fault(second), extended)
    assert again.findings == ()
    floor, rightly = evaluate(model, second), evaluate(extended, fault(second))
    for name, error in rightly.joints.items():
        assert error.nrmse < 1.1 * floor.joints[name].nrmse + 0.005
    return {finding.effect for finding in found.findings}, extended


@pytest.mark.parametrize(
    ("arm", "fault", "effect"),
    [
        (masters, late, "time_delay"), (masters, wrong_sign, "wrong_coordinates"),
        (masters, far, "encoder_scale"), (masters, slow, "time_scale"),
        (masters, leaking, "joint_coupling"), (robots, wrong_scale, "torque_scale"),
        (robots, late, "time_delay"), (robots, far, "encoder_scale"),
    ],
)  # fmt: skip
def test_a_wrong_reading_is_not_found_again(arm, fault, effect, tmp_path):
    assert judged_twice(arm(), fault, tmp_path)[0] == {effect}
