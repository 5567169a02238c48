"""Of noise, and of efforts without gravity, nothing is named: one line says what they are."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from dvrk_gravity.arms import Arm
from dvrk_gravity.diagnosis import diagnose, load, require_gravity, require_predictable
from dvrk_gravity.effects import State
from dvrk_gravity.errors import RecordingError
from dvrk_gravity.identification import identify
from dvrk_gravity.recording import Recording
from testing.world import COARSE, World

pytestmark = pytest.mark.usefixtures("brief_simulation")

KNOWN = World.draw(3, step=COARSE)
MODEL = KNOWN.model()
BETTER = "efforts of no joint are predicted better than by a constant"


@cache
def recorded(seed: int = 3) -> Recording:
    return KNOWN.record(seed, 4, 12.0, 100.0)


@cache
def weight() -> np.ndarray:
    state = State.of(recorded().position)
    return sum(term.torque(state) for term in MODEL.terms if term.WEIGHT_OF_ARM)


def with_effort(effort: np.ndarray) -> Recording:
    return replace(recorded(), effort=effort)


def noise(seed: int) -> np.ndarray:
    effort = recorded().effort
    return np.random.default_rng(seed).normal(effort.mean(axis=0), effort.std(axis=0), effort.shape)


def accepted(recording: Recording) -> None:
    motion = load([recording], MODEL).motion
    require_predictable(motion, [recording])
    require_gravity(motion, recording.source)


@pytest.mark.parametrize("seed", range(4))
def test_noise_is_refused(seed):
    with pytest.raises(RecordingError, match=BETTER):
        diagnose(with_effort(noise(seed)), MODEL)


@pytest.mark.parametrize("width", [0.05, 0.2, 0.5])
def test_noise_that_is_not_white_is_refused(width):
    """A running mean over so many seconds."""
    window = np.ones(round(width * 100.0)) / round(width * 100.0)
    smooth = np.apply_along_axis(np.convolve, 0, noise(7), window, mode="same")
    motion = load([with_effort(smooth)], MODEL).motion

    with pytest.raises(RecordingError, match=BETTER):
        require_predictable(motion, [with_effort(smooth)])


def test_efforts_of_another_motion_are_refused():
    other = with_effort(recorded(8).effort)
    motion = load([other], MODEL).motion

    with pytest.raises(RecordingError, match="or those of another motion"):
        require_predictable(motion, [other])


def test_noise_at_all_joints_but_one_is_not():
    effort = noise(1)
    effort[:, 1] = recorded().effort[:, 1]
    motion = load([with_effort(effort)], MODEL).motion

    require_predictable(motion, [with_effort(effort)])


def test_efforts_without_gravity_are_refused_by_name_of_joints():
    with pytest.raises(RecordingError, match="gravity is not in the efforts of") as refused:
        diagnose(with_effort(recorded().effort - weight()), MODEL)

    assert "shoulder_pitch" in str(refused.value)
    assert "elbow_pitch" in str(refused.value)
    assert "effort_has_gravity: {read: false} in the arm's file" in str(refused.value)


@pytest.mark.parametrize("factor", [-1.0, 1e-3, 0.5, 3.0])
def test_so_they_are_at_another_scale_or_sign(factor):
    without = with_effort(factor * (recorded().effort - weight()))
    with pytest.raises(RecordingError, match="gravity is not in the efforts of"):
        require_gravity(load([without], MODEL).motion, "without gravity")


@pytest.mark.slow
def test_a_psm_whose_weights_are_small_beside_the_rest_may_have_efforts_of_any_scale(measured_data):
    arm = Arm.load("psm")
    folder = measured_data / "psm"
    model = identify(folder / "psm_one.csv", arm, "actuator").model
    recording = replace(Recording.load(folder / "psm_one_bare.csv", arm), coordinates="actuator")
    for factor in (1.0, 0.001):
        scaled = replace(recording, effort=factor * recording.effort)
        require_gravity(load([scaled], model).motion, recording.source)


@pytest.mark.parametrize("factor", [-1.0, 0.01, 0.5])
def test_gravity_at_another_scale_or_sign_is_there(factor):
    accepted(with_effort(factor * recorded().effort))


def test_gravity_of_exchanged_joints_is_there():
    order = [0, 2, 1, 3, 5, 4, 6]
    accepted(with_effort(recorded().effort[:, order]))


def test_gravity_that_one_joint_lacks_is_a_cause_to_look_for():
    accepted(with_effort(recorded().effort - weight() * (np.arange(7) == 2)))


def test_where_weights_hardly_vary_they_are_not_missed():
    """Errors of the efforts are larger than what the motion shows of the weights."""
    still = recorded().position.mean(axis=0)
    narrow = replace(
        recorded(), position=still + 0.04 * (recorded().position - still), velocity=None
    )
    held = MODEL.torque(narrow.position)
    error = np.random.default_rng(2).normal(0.0, 0.15, held.shape) * np.abs(held)
    motion = load([replace(narrow, effort=held + error)], MODEL).motion

    require_gravity(motion, "narrow")


def test_a_weight_that_a_narrow_motion_shows_by_its_mean_alone_is_there():
    """There what the model lacks, a cable, may vary as the weight does, the other way."""
    still = recorded().position.mean(axis=0)
    position = still + 0.2 * (recorded().position - still)
    state = State.of(position)
    weights = sum(term.torque(state) for term in MODEL.terms if term.WEIGHT_OF_ARM)
    effort = MODEL.torque(position) - (weights - weights.mean(axis=0))
    narrow = replace(recorded(), position=position, velocity=None, effort=effort)

    require_gravity(load([narrow], MODEL).motion, "narrow")
