"""What happens to a simulated arm on its way stops it, whichever watch sees it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from path_driver import driven

from dvrk_gravity.arms import Arm
from dvrk_gravity.collecting import MotionStoppedError, SimulatedDriver
from dvrk_gravity.simulate import PlantFile

ECM = Arm.load("ecm")
SECOND = np.eye(ECM.n)[1]


@pytest.fixture(scope="module")
def ecm() -> PlantFile:
    return PlantFile.of(ECM)


def pushed(driver: SimulatedDriver) -> None:
    """A push that the servo resists, so that the arm does not leave its path."""
    driver.arm.push(0.3 * ECM.effort_limit * SECOND, 0.01)


STUCK_AT: dict[SimulatedDriver, float] = {}


def stuck(driver: SimulatedDriver) -> None:
    plant = driver.arm.plant
    q, v = plant.q.copy(), plant.v.copy()
    q[1], v[1] = STUCK_AT.setdefault(driver, q[1]), 0.0
    plant.reset(q, v)


def silent(driver: SimulatedDriver) -> None:
    driver.heard = False


@pytest.mark.parametrize(
    ("fault", "says"),
    [
        (pushed, "pitch's motor"),
        (stuck, "pitch('s motor| is .* from its set point)"),
        (silent, r"no valid measured_js for 0\.1 s; sent hold"),
    ],
)
def test_what_happens_to_a_simulated_arm_on_its_way_stops_it_and_it_is_held(
    tmp_path: Path, ecm: PlantFile, fault: Callable, says: str
) -> None:
    drivers: set[SimulatedDriver] = set()

    def disturb(driver: SimulatedDriver) -> None:
        drivers.add(driver)
        if 3.0 < driver.arm.plant.time < 4.0:
            fault(driver)
        else:
            driver.heard = True

    with pytest.raises(MotionStoppedError, match=says):
        driven(ecm, tmp_path / "bag", disturb)
    (driver,) = drivers
    assert np.abs(driver.arm.plant.v).max() < 1e-2
