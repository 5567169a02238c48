"""What is planned, set and checked for arms that are no MTM: numbers and units of joints."""

from __future__ import annotations

import numpy as np
import pytest
from made_up_arm import made_up_arm

from dvrk_gravity.arms import Arm
from dvrk_gravity.cli.options import fixed_positions
from dvrk_gravity.compensate import (
    EffortLimits,
    PassivityObserver,
    slew,
)
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.parameters import node_parameters
from dvrk_gravity.planning import Multisine
from dvrk_gravity.recording import Recording, check


@pytest.fixture(scope="module")
def made_up(tmp_path_factory) -> Arm:
    return made_up_arm(tmp_path_factory.mktemp("arm"))


def test_units_of_parameters_follow_the_joints(made_up):
    table = node_parameters(made_up)
    assert table["effort_limit"].unit == "N·m or N"
    assert table["speed_limit"].unit == "rad/s or m/s"
    assert table["speed_limit"].default == (4.0, 4.0, 0.4, 4.0)
    assert node_parameters(Arm.load("mtmr"))["effort_limit"].unit == "N·m"


def test_limits_with_a_transmission_hold_in_both_spaces(made_up):
    limits = EffortLimits(made_up, made_up.effort_limit, made_up.actuator_effort_limit)
    rng = np.random.default_rng(0)
    for torque in rng.normal(0, 60, (200, made_up.n)):
        clipped = limits.clip(torque)
        assert limits.contains(clipped)
        step = 0.1 * made_up.effort_limit
        assert limits.contains(slew(np.zeros(made_up.n), clipped, step, limits))


def recording(arm: Arm, position: np.ndarray, effort: np.ndarray) -> Recording:
    time = np.arange(len(position)) * 0.01
    return Recording(arm.joint_names, time, position, effort=effort, arm=arm)


def test_units_of_a_recording_are_checked_by_the_arm_s_own_reach(made_up):
    position, _ = Multisine.draw(made_up, 1).at(np.arange(2000) * 0.01)
    effort = 0.1 * made_up.effort_limit * np.sin(position / made_up.scale)
    right = {w.kind for w in check(recording(made_up, position, effort))}
    assert not right & {"position_unit", "effort_unit"}
    wrong = position.copy()
    wrong[:, 2] *= 1e3
    (found,) = check(recording(made_up, wrong, effort))
    assert (found.kind, found.joint, found.unusable) == ("position_unit", "insertion", True)
    (found,) = check(recording(made_up, position, effort * [1, 1, 1e3, 1]))
    assert (found.kind, found.joint) == ("effort_unit", "insertion")


def test_a_sliding_joint_that_moves_millimetres_has_moved(made_up):
    position = np.zeros((500, 4)) + made_up.range[0]
    position[:, 2] += 0.01 * (1 + np.sin(np.arange(500) * 0.05))
    found = {w.joint: w for w in check(recording(made_up, position, np.zeros((500, 4))))
             if w.kind == "no_motion"}  # fmt: skip
    assert set(found) == {"yaw", "pitch", "roll"}


def test_passivity_is_observed_equally_whether_a_joint_turns_or_slides():
    """The same energies at a tenth of the speed: the factors are the same."""
    half, coupled = np.full(1, 0.9), np.zeros(1, dtype=bool)
    turns = PassivityObserver(half, np.array([0.4]), coupled)
    slides = PassivityObserver(half, np.array([0.04]), coupled, np.array([0.1]))
    lowest = 1.0
    for k in range(2000):
        speed = np.array([0.002 * k * np.sin(0.05 * k)])
        first = turns.update(speed, 0.5 * np.sign(speed), 0.005 * k)
        second = slides.update(0.1 * speed, 5.0 * np.sign(speed), 0.005 * k)
        np.testing.assert_allclose(first, second, atol=1e-12)
        lowest = min(lowest, float(first[0]))
    assert lowest < 1.0


def test_where_joints_stood_is_given_in_units_of_their_kind(made_up):
    assert fixed_positions(["insertion=20mm,others=0"], made_up) == {
        "yaw": 0.0, "pitch": 0.0, "insertion": 0.02, "roll": 0.0,
    }  # fmt: skip
    assert fixed_positions(["insertion=0.02m", "yaw=90deg"], made_up) == {
        "insertion": 0.02, "yaw": pytest.approx(np.pi / 2),
    }  # fmt: skip
    for given, said in (
        ("insertion=2deg", "20mm"), ("yaw=2mm", "2.5deg"), ("insertion=99m", "10 m"),
        ("yaw=300deg", "yaw at .* deg"), ("insertion=2m", "insertion at .* mm"),
        ("others=5deg", "insertion"), ("elbow_pitch=0", "yaw, pitch, insertion, roll"),
    ):  # fmt: skip
        with pytest.raises(ConfigError, match=f"--at: got .*, expected .*{said}"):
            fixed_positions([given], made_up)
