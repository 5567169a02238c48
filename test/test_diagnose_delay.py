"""Late efforts of an arm whose model's torques are noisy, for its accelerations are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dvrk_gravity.diagnosis import diagnose
from dvrk_gravity.identification import identify
from testing.lab_motion import draw_calibration, draw_other
from testing.mujoco_world import MujocoWorld

pytestmark = pytest.mark.usefixtures("brief_simulation")

SEED, DELAY = 41, 0.05  # s; of a UR5 that shows no velocities, at 200 Hz
DURATION = 15.0  # s, of the motion that is diagnosed
SLOW = pytest.mark.slow


@pytest.mark.parametrize("motion", [1, pytest.param(2, marks=SLOW), pytest.param(3, marks=SLOW)])
def test_efforts_that_are_late_are_no_friction_though_accelerations_are_noisy(motion):
    world = MujocoWorld.draw("ur5", SEED)
    calibration = draw_calibration(world.arm, SEED)
    model = identify(world.record(world.truth(calibration), SEED), world.arm).model
    truth = world.truth(draw_other(world.arm, motion, calibration), DURATION)
    late = [np.interp(truth.time - DELAY, truth.time, effort) for effort in truth.effort.T]
    recording = world.record(replace(truth, effort=np.column_stack(late)), motion)

    finding = diagnose(recording, model).findings[0]

    delay = finding.parameters["delay"]
    whole = DELAY + world.sensors.delay
    assert finding.effect == "time_delay"
    assert delay.low < whole < delay.high
    assert delay.value == pytest.approx(whole, rel=0.25)
