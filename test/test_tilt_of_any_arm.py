"""A base that was level when an arm was identified, and leans: what its shaft bears shows then."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from test_arms_dynamics import UR5

from dvrk_gravity import Arm, diagnose, evaluate, identify
from dvrk_gravity.arms.tree import nominal_inertias
from testing.plain_world import PlainWorld

TILT = np.radians(4.0)


@pytest.mark.usefixtures("four_folds")
def test_a_tilt_is_told_alone_though_nothing_showed_what_weighs_on_the_upright_joint():
    arm = Arm.load(UR5)
    world = PlainWorld.of(arm, nominal_inertias(arm))
    model = identify(replace(world.record(1, 20.0), arm=None), arm).model
    leaning = replace(world, arm=replace(arm, base_rpy=(0.0, TILT, 0.0)))

    diagnosis = diagnose(replace(leaning.record(2, 15.0), arm=None), model)

    (found,) = diagnosis.findings
    assert (found.effect, found.in_model) == ("base_tilt", True)
    assert found.parameters["pitch"].value == pytest.approx(TILT, rel=0.1)
    other = replace(leaning.record(3, 10.0), arm=None)
    before, after = (evaluate(each, other).joints for each in (model, diagnosis.model))
    assert after["shoulder_pan_joint"].rmse < 0.4 * before["shoulder_pan_joint"].rmse
