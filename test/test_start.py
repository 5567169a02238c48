"""Starts of a simulated arm with the shipped plant's noise: no joint moves."""

from __future__ import annotations

import numpy as np
import pytest
from support import MODEL_FILE

from dvrk_gravity import TorqueModel
from dvrk_gravity.arms import JOINT_NAMES
from dvrk_gravity.compensate import SampleReader, Settings, Status, Supervisor
from dvrk_gravity.simulate import PlantFile, SimulatedArm

STEP = 1e-3
POSES = np.radians(
    [
        [0.0, 0.0, 0.0, 0.0, 90.0, 0.0, 0.0],
        [-10.0, 20.0, -15.0, 40.0, 60.0, 20.0, 30.0],
        [-20.0, 10.0, 20.0, -50.0, 120.0, -25.0, -60.0],
    ]
)


def largest_motion(seed: int, rate: int, effort=None, models=(1.0, 1.0)) -> float:
    """Hold a pose, start, and return how far the joint that moves most gets in 2 s, deg.

    Args:
        seed: Of the pose and the noise.
        rate: Messages a second.
        effort: Makes what the message says of the measured efforts.
        models: Part of gravity that the model knows, at first and from half a start on.
    """
    rng = np.random.default_rng(seed)
    truth = PlantFile.load("mtmr_28002")
    plant = truth.plant()
    # Poses in which the shipped model is the plant's own: within the range of its calibration.
    plant.reset(POSES[seed % 3] + np.radians(rng.uniform(-5.0, 5.0, 7)))
    arm = SimulatedArm(plant, truth.sensors, seed, builtin_compensation=False, dt=STEP)
    first, then = (Settings.from_parameters(heavy(part)) for part in models)
    supervisor, half_way = Supervisor(first), None
    reader = SampleReader(JOINT_NAMES)
    each = round(1.0 / rate / STEP)
    start, moved = None, 0.0
    for k in range(300, 3300):
        arm.step()
        measured = arm.measure()
        if k % each or k < 600:
            continue
        if start is None:
            start = plant.q.copy()
        now = k * STEP
        if half_way is None and supervisor.status is Status.STARTING:
            half_way = now + 0.05
        if half_way is not None and now >= half_way and supervisor.settings is not then:
            supervisor.configure(then, now)
        told = measured.effort if effort is None else effort(measured.effort)
        stamp = int(now * 1e9)
        sample = reader.read(stamp, JOINT_NAMES, measured.position, measured.velocity, told)
        command = supervisor.command(sample, now, stamp)
        if command is not None:
            arm.servo_jf(command)
        moved = max(moved, float(np.abs(plant.q - start).max()))
    assert supervisor.status is Status.COMMANDING, supervisor.reason
    return float(np.degrees(moved))


def heavy(part: float) -> dict:
    """Return the shipped model's parameters with a part of its gravity."""
    values = TorqueModel.load(MODEL_FILE).parameters()
    return values | {"beta": tuple(part * np.array(values["beta"]))}


@pytest.mark.parametrize("part", [0.5, 1.6])
def test_a_model_that_is_changed_during_the_start_throws_no_joint(part):
    assert largest_motion(1, 200, models=(part, 1.0)) < 2.0


@pytest.mark.parametrize("rate", [pytest.param(1000, marks=pytest.mark.slow), 200])
def test_no_start_moves_a_joint_by_two_degrees(rate):
    assert max(largest_motion(seed, rate) for seed in range(6)) < 2.0


def test_a_start_without_measured_efforts_moves_no_joint_either():
    assert largest_motion(0, 200, effort=lambda _: []) < 2.0
    assert largest_motion(1, 200, effort=lambda e: np.full(7, np.nan)) < 2.0


LIMIT = TorqueModel.load(MODEL_FILE).arm.effort_limit
READINGS = {
    "an offset": lambda effort: effort + 0.1 * LIMIT,
    "too large": lambda effort: 1.3 * effort,
    "too small": lambda effort: 0.7 * effort,
    "a dead shoulder": lambda effort: effort * [1, 0, 1, 1, 1, 1, 1],
    "a dead wrist": lambda effort: effort * [1, 1, 1, 1, 1, 0, 1],
    "steps": lambda effort: np.round(effort / 0.03) * 0.03,
}


@pytest.mark.parametrize("kind", READINGS)
def test_efforts_that_are_read_wrong_throw_no_joint(kind):
    assert largest_motion(1, 200, READINGS[kind]) < 2.0
