"""Accelerations of positions that are read in steps: inertia that is fitted to them."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from dvrk_gravity.recording import Bands, LowPass, Recording, prepare

RATE, BAND = 200.0, 8.0  # Hz
COARSE = 3e-3  # rad: an encoder step of an MTM's wrist


def swing(frequency: float, amplitude: float) -> tuple[NDArray[np.float64], ...]:
    """Return time, position and acceleration of a swing with a second, faster one in it."""
    time = np.arange(0.0, 30.0, 1.0 / RATE)
    slow, fast = 2.0 * np.pi * frequency, 2.0 * np.pi * 1.7 * frequency
    q = amplitude * (np.sin(slow * time) + 0.3 * np.sin(fast * time + 1.0))
    qdd = -amplitude * (slow**2 * np.sin(slow * time) + 0.3 * fast**2 * np.sin(fast * time + 1.0))
    return time, q, qdd


def seen(time: NDArray[np.float64], q: NDArray[np.float64], step: float) -> NDArray[np.float64]:
    """Return the acceleration below the band of positions that are read in steps."""
    recording = Recording(("joint",), time, np.round(q / step)[:, None] * step, None, None)
    bands = Bands(20.0, 20.0, BAND, np.inf, 20.0, for_fit=False)
    prepared = prepare(recording, bands, warnings=())
    used = LowPass(BAND, RATE)(prepared.acceleration[:, 0])
    return np.interp(time, prepared.filtered.time, used)  # without the ends


def fitted_inertia(seen_qdd: NDArray[np.float64], qdd: NDArray[np.float64]) -> float:
    """Return the inertia that is fitted where it is 1: the least squares of torque over qdd."""
    inside = slice(200, -200)
    return float(seen_qdd[inside] @ qdd[inside] / (seen_qdd[inside] @ seen_qdd[inside]))


@pytest.mark.parametrize(("frequency", "attenuated"), [(0.2, 0.5), (0.4, 0.9)])
def test_an_inertia_is_not_told_too_small_for_the_steps_of_an_encoder(frequency, attenuated):
    time, q, qdd = swing(frequency, 0.1)
    position_alone = np.round(q / COARSE) * COARSE
    for _ in range(2):
        position_alone = np.gradient(LowPass(20.0, RATE)(position_alone), time)

    assert fitted_inertia(LowPass(BAND, RATE)(position_alone), qdd) < attenuated
    assert fitted_inertia(seen(time, q, COARSE), qdd) == pytest.approx(1.0, abs=0.03)


def test_where_steps_are_fine_nothing_is_taken_away():
    time, q, qdd = swing(0.4, 0.1)
    assert np.std((seen(time, q, 1e-5) - qdd)[200:-200]) < 0.002 * np.std(qdd)


def test_a_vibration_that_is_larger_than_the_steps_stays():
    """Five hertz, as a wrist on its cables vibrates, beside a slow swing."""
    time, q, _ = swing(0.4, 0.1)
    vibration = 0.01 * np.sin(2.0 * np.pi * 5.0 * time)
    both, alone = seen(time, q + vibration, COARSE), seen(time, q, COARSE)
    passed = 1.0 / (1.0 + (5.0 / BAND) ** 4) / (1.0 + (5.0 / 20.0) ** 4)
    size = np.sqrt(2.0) * np.std((both - alone)[200:-200])
    assert size == pytest.approx(0.01 * (10.0 * np.pi) ** 2 * passed, rel=0.01)
