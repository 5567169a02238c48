"""From a recording to filtered samples: low-pass, derivative, times, grid, gaps, stale samples."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from recording_samples import column, held, through, wave

from dvrk_gravity.arms import JOINT_NAMES
from dvrk_gravity.errors import RecordingError, ShapeError
from dvrk_gravity.recording import LowPass, Recording, derivative, retimed

CLEAN = wave(6000)
STATIC = replace(CLEAN, time=None, velocity=None)
RATE = 200.0
TIME = np.arange(4000) / RATE


@pytest.mark.parametrize("cutoff", [20.0, 5.65, 2.0])
def test_lowpass_halves_the_amplitude_at_the_cutoff_and_shifts_nothing(cutoff):
    low = LowPass(cutoff, RATE)
    wave = np.sin(2 * np.pi * cutoff * TIME)
    middle = slice(1000, 3000)
    np.testing.assert_allclose(low(wave)[middle], 0.5 * wave[middle], atol=1e-6)
    slow = np.sin(2 * np.pi * cutoff / 20 * TIME)
    gain = 1 / (1 + (np.tan(np.pi * cutoff / 20 / RATE) / np.tan(np.pi * cutoff / RATE)) ** 4)
    np.testing.assert_allclose(low(slow)[middle], gain * slow[middle], atol=1e-6)


def test_edge_is_where_the_ends_stop_to_matter():
    """Two signals that differ only beyond the end: the filter sees one of them cut short."""
    rng = np.random.default_rng(0)
    signal = np.cumsum(rng.normal(size=4000)) / 20
    low = LowPass(5.65, RATE)
    error = np.abs(low(signal[:2000]) - low(signal)[:2000])
    assert error[-1] > 0.05
    assert error[: -low.edge].max() < 2e-3 * error.max()
    assert error[: -low.edge // 2].max() > 2e-3 * error.max()


def test_derivative_is_exact_to_degree_four_ends_included():
    time = np.linspace(-1.0, 1.0, 21)
    powers = time[:, None] ** np.arange(5)
    expected = np.arange(5) * time[:, None] ** np.maximum(np.arange(5) - 1, 0)
    np.testing.assert_allclose(derivative(powers, 10.0), expected, atol=1e-12)
    np.testing.assert_allclose(derivative(time**4, 10.0), expected[:, 4], atol=1e-12)
    assert np.abs(derivative(time**5, 10.0) - 5 * time**4).max() > 1e-4


def test_impossible_cutoffs_and_too_few_samples_are_refused():
    for cutoff in (0.0, -1.0, 100.0, float("nan")):
        with pytest.raises(RecordingError, match="100 Hz"):
            LowPass(cutoff, RATE)
    with pytest.raises(ShapeError, match="to filter"):
        LowPass(5.0, RATE)(np.zeros(5))
    with pytest.raises(ShapeError, match="to differentiate"):
        derivative(np.zeros(4), RATE)


# Samples taken off their stamps

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


def test_samples_are_put_back_to_the_times_at_which_they_were_read():
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
    prepared = through(recording)
    _, _, true = motion(prepared.filtered.time)
    wrong = through(replace(recording, velocity=None))
    inner, fine = slice(400, -400), slice(0, 4)
    error = np.std((prepared.acceleration - true)[inner, fine])
    assert error < 0.2 * np.std((wrong.acceleration - true)[inner, fine])
    assert any("corrected by matching" in str(warning) for warning in prepared.warnings)


def test_stamps_that_are_right_enough_are_left_alone():
    for jitter in (0.0, 1e-4):
        recording, _ = recorded(jitter)
        assert retimed(recording) is recording
    noise = 1e-3 * np.random.default_rng(1).normal(size=recording.position.shape)
    noisy = replace(recorded(0.0)[0], position=recorded(0.0)[0].position + noise)
    assert retimed(noisy) is noisy  # noise that the joints do not share is no jitter
    bare = replace(recorded(2e-3)[0], velocity=None)
    assert retimed(bare) is bare  # nothing is known without velocities


# Prepared recordings


def test_a_motion_between_jittering_stamps_is_followed():
    rng = np.random.default_rng(0)
    time = np.sort(CLEAN.time + rng.uniform(-2e-3, 2e-3, 6000))
    omega, size = 2 * np.pi * np.linspace(0.3, 0.9, 7), np.linspace(0.4, 0.7, 7)
    jittering = replace(CLEAN, time=time, position=size * np.sin(np.outer(time, omega)))
    grid = through(jittering, cutoff=40.0).filtered
    np.testing.assert_allclose(np.diff(grid.time), 1.0 / jittering.rate, rtol=1e-6)
    truth = size * np.sin(np.outer(grid.time, omega))
    assert np.abs(grid.position - truth)[20:-20].max() < 2e-4


def test_everything_goes_through_one_filter():
    prepared = through(CLEAN, cutoff=10.0)
    assert prepared.warnings == ()
    assert len(prepared.processing_log) == 1
    core = slice(prepared.filter.edge, -prepared.filter.edge)
    omega = 2 * np.pi * np.linspace(0.3, 0.9, 7)
    gain = 1 / (1 + (np.tan(omega / 2 / 200) / np.tan(np.pi * 10 / 200)) ** 4)
    got = prepared.filtered
    np.testing.assert_allclose(got.position[core], gain * CLEAN.position[core], atol=1e-6)
    np.testing.assert_allclose(got.velocity[core], gain * CLEAN.velocity[core], atol=1e-4)
    expected = -gain * omega**2 * CLEAN.position[core]
    np.testing.assert_allclose(prepared.acceleration[core], expected, atol=3e-3)
    assert np.std(got.effort - 0.02 * got.position) < 0.5e-4


def test_the_velocity_is_derived_only_where_the_column_is_worse():
    wrong = column(CLEAN, "velocity", "wrist_roll", lambda v: 1.18 * v)
    offset = column(wrong, "velocity", "outer_yaw", lambda v: v + 1e-3)
    prepared = through(offset, cutoff=10.0)
    core = slice(prepared.filter.edge, -prepared.filter.edge)
    difference = prepared.filtered.velocity[core] - through(CLEAN, 10.0).filtered.velocity[core]
    np.testing.assert_allclose(difference[:, 6], 0.0, atol=2e-4)
    np.testing.assert_allclose(difference[:, 0], 1e-3, atol=1e-9)
    absent = through(replace(CLEAN, velocity=None), 10.0)
    got = absent.filtered.velocity[core]
    np.testing.assert_allclose(got, CLEAN.velocity[core], atol=2e-2)


def test_stale_samples_are_replaced():
    rows = np.random.default_rng(0).choice(np.arange(10, 5990), 800, replace=False)
    prepared = through(held(CLEAN, np.sort(rows)), cutoff=20.0)
    assert any(line.startswith("800 stale samples") for line in prepared.processing_log)
    clean = through(CLEAN, cutoff=20.0)
    error = np.abs(prepared.filtered.position - clean.filtered.position)[100:-100]
    assert error.max() < 2e-4
    assert np.abs(held(CLEAN, rows).position - CLEAN.position).max() > 5e-3
    assert len(prepared.filtered) == 6000


def test_a_trajectory_is_split_at_gaps_and_loses_what_is_too_short():
    time = CLEAN.time.copy()
    time[2000:] += 0.5
    time[2040:] += 0.5
    prepared = through(replace(CLEAN, time=time), cutoff=10.0)
    assert prepared.parts == (slice(0, 2000), slice(2000, 5960))
    assert any("2 parts, 40 samples" in line for line in prepared.processing_log)
    assert [prepared.filtered.time[part.start] for part in prepared.parts] == [0.0, time[2040]]


def test_what_nothing_should_be_fitted_to_is_refused():
    for recording, tokens in (
        (replace(CLEAN, position=np.rad2deg(CLEAN.position)), "wave: outer_yaw: position"),
        (replace(CLEAN, position=np.zeros((6000, 7))), "wave: no joint moves"),
        (CLEAN.rows(slice(0, 60)), "wave: has no 128 samples"),
        (replace(CLEAN, time=20 * CLEAN.time, velocity=None), "wave: cut-off 10 Hz"),
    ):
        with pytest.raises(RecordingError) as caught:
            through(recording, cutoff=10.0)
        assert str(caught.value).startswith(tokens)
