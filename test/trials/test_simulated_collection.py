"""A simulated arm is collected from, with a gentle hand on it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from path_driver import driven, plan_of

from dvrk_gravity.arms import Arm
from dvrk_gravity.collecting import SimulatedDriver
from dvrk_gravity.recording import Recording
from dvrk_gravity.simulate import PlantFile

ECM = Arm.load("ecm")


SECOND = np.eye(ECM.n)[1]


@pytest.fixture(scope="module")
def ecm() -> PlantFile:
    return PlantFile.of(ECM)


def test_a_simulated_arm_is_moved_and_recorded_as_planned_even_with_a_gentle_hand(
    tmp_path: Path, ecm: PlantFile
) -> None:
    def hand(driver: SimulatedDriver) -> None:
        if driver.arm.plant.time > 4.5:
            driver.arm.push(0.02 * ECM.effort_limit * SECOND, 0.01)

    driven(ecm, tmp_path / "bag", hand)
    recording = Recording.load(tmp_path / "bag")
    plan = plan_of("ecm", size=0.9)
    assert recording.time is not None
    assert recording.rate == pytest.approx(200.0)
    late = plan.at(np.maximum(recording.time - 0.08, 0.0))[0]  # its servo lags
    assert (np.abs(recording.position - late).max(axis=0) < 0.03 * ECM.scale).all()
    assert recording.effort is not None
