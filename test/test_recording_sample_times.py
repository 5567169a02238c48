"""Samples taken off their stamps are put back where positions and velocities tell."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dvrk_gravity.arms import JOINT_NAMES
from dvrk_gravity.recording import Recording, prepare, retimed

RATE = 200.0
STEP = np.array([2.5e-5, 3e-5, 2.6e-5, 1.5e-4, 3e-3, 3e-3, 6e-3])  # rad, encoders


def motion(time):
    joint = np.arange(1, 8)
    angle = 2.0 * np.pi * (0.1 + 0.05 * joint) * time[:, None] + joint
    rate = 2.0 * np.pi * (0.1 + 0.05 * joint)
    return 0.6 * np.sin(angle), 0.6 * rate * np.cos(angle), -0.6 * rate**2 * np.sin(angle)


def recorded(jitter: float, seed: int = 0) -> tuple[Recording, np.ndarray]:
    """Return a recording and when its samples were taken."""
    random = np.random.default_rng(seed)
    stamps = np.arange(4000) / RATE
    taken = stamps + jitter * random.uniform(-1.0, 1.0, len(stamps))
    q, qd, _ = motion(taken)
    q = np.round(q / STEP) * STEP
    qd = qd * (1.0 + 0.01 * random.normal(size=7)) + 0.002 * random.normal(size=qd.shape)
    return Recording(JOINT_NAMES, stamps, q, qd, np.zeros_like(q)), taken


def test_times_come_back():
    recording, taken = recorded(2e-3)
    found = retimed(recording)
    rows = np.searchsorted(recording.time, found.time[0]) + np.arange(len(found))
    inner = slice(400, -400)
    error = found.time - taken[rows]
    assert len(found) == len(recording)
    assert np.std((recording.time - taken)[inner]) > 1e-3
    assert np.std(error[inner]) < 0.2e-3


def test_acceleration_is_that_of_the_motion_and_not_of_the_jitter():
    recording, _ = recorded(2e-3)
    prepared = prepare(recording)
    segment = prepared.segments[0]
    _, _, true = motion(segment.recording.time)
    wrong = prepare(replace(recording, velocity=None)).segments[0]
    inner, fine = slice(400, -400), slice(0, 4)
    error = np.std((segment.acceleration - true)[inner, fine])
    assert error < 0.2 * np.std((wrong.acceleration - true)[inner, fine])
    assert any("corrected by matching" in str(warning) for warning in prepared.warnings)


@pytest.mark.parametrize("jitter", [0.0, 1e-4])
def test_stamps_that_are_right_are_left_alone(jitter):
    recording, _ = recorded(jitter)
    assert retimed(recording) is recording


def test_noise_that_joints_do_not_share_is_no_jitter():
    recording, _ = recorded(0.0)
    noise = 1e-3 * np.random.default_rng(1).normal(size=recording.position.shape)
    noisy = replace(recording, position=recording.position + noise)
    assert retimed(noisy) is noisy


def test_without_velocities_nothing_is_known():
    recording, _ = recorded(2e-3)
    bare = replace(recording, velocity=None)
    assert retimed(bare) is bare
