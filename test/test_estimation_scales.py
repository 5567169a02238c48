"""Scales of channels by a torque that is known: unbiased by noise, with intervals that hold."""

from __future__ import annotations

import numpy as np

from dvrk_gravity.estimation import solve_scales

GAIN, RATE, COUNT = np.array([10.0, 4.0]), 50.0, 600


def problem(seed: int):
    """Readings of two channels that share one unknown coefficient, as noisy as they are large."""
    random = np.random.default_rng(seed)
    time = np.arange(COUNT) / RATE
    known = np.column_stack([np.sin(time), np.cos(0.7 * time)])
    shared = np.column_stack([np.cos(1.3 * time), np.sin(2.1 * time)])[:, :, None]
    own = np.sign(np.sin(3.0 * time))[:, None, None] * np.ones((1, 2, 1))
    clean = (known + 0.8 * shared[:, :, 0]) / GAIN + 0.05 * own[:, :, 0]
    reading = clean + clean.std(axis=0) * random.normal(size=clean.shape)
    return reading, known, shared, own


def solved(seed: int):
    reading, known, shared, own = problem(seed)
    return solve_scales(
        reading, known, shared, np.array([5.0]), own, np.full((2, 1), 1.0), RATE, np.full(2, 7.0)
    )


def test_noise_does_not_pull_a_scale_towards_zero_as_regressing_on_readings_does():
    found = np.mean([solved(seed).gain for seed in range(40)], axis=0)
    np.testing.assert_allclose(found, GAIN, rtol=0.03)
    reading, known, shared, _ = problem(0)
    naive = (known + 0.8 * shared[:, :, 0]).T @ reading / (reading.T @ reading)
    assert (np.diag(naive) < 0.7 * GAIN).all()


def test_the_intervals_of_scales_hold_the_truth():
    inside = []
    for seed in range(200):
        found = solved(seed)
        # Of the inverse the noise is Gaussian.
        off = (1.0 / found.gain - 1.0 / GAIN) * found.gain
        inside += (np.abs(off) < 1.96 * found.error).tolist()
    assert 0.92 < np.mean(inside) < 0.98


def test_a_channel_that_shows_nothing_of_the_known_torque_has_no_certain_scale():
    reading, known, shared, own = problem(0)
    reading[:, 1] -= (known + 0.8 * shared[:, :, 0])[:, 1] / GAIN[1]
    known[:, 1] = shared[:, 1] = 0.0
    found = solve_scales(
        reading, known, shared, np.array([5.0]), own, np.full((2, 1), 1.0), RATE, np.full(2, 7.0)
    )
    assert found.error[1] > 1.0
    assert found.error[0] < 0.1
