"""The arm itself under compensation: the true torque holds it, and a twentieth less does not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dvrk_gravity.effects import Gravity
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.simulate import PlantFile, SimulatedArm

DT = 1e-3  # s


@pytest.fixture(scope="module")
def truth() -> PlantFile:
    return PlantFile.load("mtmr_28002")


def drift(truth: PlantFile, model: TorqueModel, poses: np.ndarray, duration: float) -> np.ndarray:
    """Return (poses,) largest motion of a joint from where the compensated arm was put, deg."""
    found = []
    for seed, pose in enumerate(poses):
        plant = truth.plant(friction_scale=0.1)
        plant.reset(pose)
        mtm = SimulatedArm(plant, truth.sensors, seed, builtin_compensation=False)
        worst = 0.0
        for step in range(round(duration / DT)):
            if step % 5 == 0:
                mtm.servo_jf(model.torque(mtm.measure().position))
            mtm.step()
            worst = max(worst, np.abs(plant.q - pose).max())
        found.append(worst)
    return np.degrees(found)


def random_poses(truth: PlantFile, count: int) -> np.ndarray:
    arm = truth.model.arm
    share = np.random.default_rng(4).uniform(0.05, 0.95, (count, 7))
    return arm.lower + share * (arm.upper - arm.lower)


def test_the_true_torque_holds_with_a_tenth_of_the_friction(truth: PlantFile) -> None:
    """For as long as the arm takes to fall without it."""
    moved = drift(truth, truth.model, random_poses(truth, 4), 2.5)
    assert moved.max() < 0.5


def test_with_a_twentieth_of_its_weight_missing_it_falls(truth: PlantFile) -> None:
    terms = tuple(
        replace(term, beta=0.95 * term.beta) if isinstance(term, Gravity) else term
        for term in truth.model.terms
    )
    moved = drift(truth, TorqueModel(truth.model.arm, terms), random_poses(truth, 3), duration=2.5)
    assert (moved > 2.0).all()
