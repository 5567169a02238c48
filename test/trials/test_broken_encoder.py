"""An encoder that breaks while the arm is commanded: what its readings show ends in a hold."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from support import MODEL_FILE

from dvrk_gravity import TorqueModel
from dvrk_gravity.compensate import Sample, Settings, Status, Supervisor
from dvrk_gravity.simulate import PlantFile, SimulatedArm

STEP = 2e-3
POSE = np.radians([0.0, 15.0, 5.0, 30.0, 80.0, 10.0, 0.0])
FASTEST = np.radians(30.0)  # rad/s, that no joint may reach before the hold
SHOULDER = 1

Breaks = Callable[[np.ndarray, np.ndarray, float], tuple[np.ndarray, np.ndarray]]


def ends(breaks: Breaks, push: float = 0.0, seed: int = 3) -> tuple[Supervisor, float, float]:
    """Command an arm whose readings break at 3 s, and whose shoulder a hand pushes then.

    Args:
        breaks: Makes readings of positions, velocities and the time since then, s.
        push: Torque of the hand, for 0.3 s, N·m.
        seed: Of the sensors' noise.

    Returns:
        The supervisor after 6 s, the shoulder's largest speed until the hold, rad/s, and when it
        came, s.
    """
    truth = PlantFile.load("mtmr_28002")
    plant = truth.plant(friction_scale=0.3)
    plant.reset(POSE)
    arm = SimulatedArm(plant, truth.sensors, seed, builtin_compensation=False, dt=STEP)
    supervisor = Supervisor(Settings.from_parameters(TorqueModel.load(MODEL_FILE).parameters()))
    fastest, held = 0.0, np.inf
    for k in range(300, int(6.0 / STEP)):
        now = k * STEP
        if k == round(3.0 / STEP):
            assert supervisor.status is Status.COMMANDING, supervisor.reason
            arm.push(push * np.eye(7)[SHOULDER], 0.3)
        arm.step()
        measured = arm.measure()
        position, velocity = np.array(measured.position), np.array(measured.velocity)
        if now >= 3.0:
            position, velocity = breaks(position, velocity, now - 3.0)
        stamp = int(now * 1e9)
        command = supervisor.command(Sample(stamp, position, velocity, measured.effort), now, stamp)
        if supervisor.hold_due:
            held = min(held, now)
            arm.hold()
            supervisor.hold_due = False
        elif command is not None:
            arm.servo_jf(command)
        if now >= 3.0 and held == np.inf:
            fastest = max(fastest, abs(float(plant.v[SHOULDER])))
    return supervisor, fastest, held


class Frozen:
    """The shoulder's position stays where it is; its velocity lives."""

    def __init__(self) -> None:
        self.at: float | None = None

    def __call__(self, position, velocity, since):
        self.at = position[SHOULDER] if self.at is None else self.at
        position[SHOULDER] = self.at
        return position, velocity


def drifting(rate: float) -> Breaks:
    """Return readings of a shoulder that drifts without a velocity."""

    def breaks(position, velocity, since):
        position[SHOULDER] += rate * since
        return position, velocity

    return breaks


@pytest.mark.parametrize("push", [0.05, -0.05])
def test_a_frozen_position_under_a_living_velocity_ends_in_a_hold_before_the_joint_is_fast(push):
    supervisor, fastest, held = ends(Frozen(), push)

    assert fastest < FASTEST
    assert held < 4.0
    assert supervisor.status is Status.FAULT
    assert "shoulder_pitch" in supervisor.reason


@pytest.mark.parametrize("rate", [0.06, -0.3])
def test_a_position_that_drifts_without_a_velocity_ends_in_a_hold(rate):
    supervisor, fastest, held = ends(drifting(rate))

    assert supervisor.status is Status.FAULT
    assert "shoulder_pitch" in supervisor.reason
    assert held < 3.0 + 0.12 / abs(rate)  # before it has drifted by 7 deg
    assert fastest < FASTEST


def test_a_hand_that_moves_an_arm_of_sound_encoders_is_left_alone():
    supervisor, fastest, held = ends(lambda position, velocity, since: (position, velocity), 0.2)

    assert fastest > 0.1
    assert supervisor.status is Status.COMMANDING
    assert held == np.inf
