"""A motion that repeats shows its own noise, and holds nothing out that it shows again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from diagnosed import ARM, HALF, MIDDLE, model, moving
from recording_samples import shared_data
from support import MODEL_FILE

from dvrk_gravity import diagnose
from dvrk_gravity.diagnosis import FilteredData, load
from dvrk_gravity.estimation import Repetition, find_common_time, find_repetition, repetition_noise
from dvrk_gravity.recording import Recording

PERIOD = 10.0  # s
TURNS = 2.0 * np.pi / PERIOD * np.array([2.0, 4.0, 3.0, 5.0])  # rad/s


def test_what_differs_between_periods_is_the_noise_whatever_repeats():
    random, time = np.random.default_rng(0), np.arange(1200) / 40.0
    level = np.array([0.001, 0.01, 0.03, 0.05])
    wave = np.sin(2.0 * np.pi * time / 11.665)[:, None] * np.linspace(0.1, 1.0, 4)
    # Smooth over a few samples, as everything is that has been through a low-pass.
    white = random.normal(size=(1206, 4))
    noise = np.apply_along_axis(np.convolve, 0, white, np.hanning(9), "same")[3:-3]
    noise *= level / noise.std(axis=0)
    known, repetition = np.ones(wave.shape, dtype=bool), Repetition(11.665, 2.57)

    np.testing.assert_allclose(
        repetition_noise(repetition, time, wave + noise, known), level, rtol=0.15
    )
    few = Repetition(10.0, 1.1)
    assert np.isnan(repetition_noise(few, time[:440], wave[:440], known[:440])).all()


@pytest.mark.parametrize("missed", [1.0, 0.37], ids=["a period", "some of a period"])
def test_the_period_is_found_across_a_gap_and_phases_agree_on_either_side(missed):
    time = np.arange(5000) / 200.0
    q = np.sin(np.outer(2.0 * np.pi * time / PERIOD, [1.0, 2.0, 3.0, 4.0]) + np.arange(4))
    part = (np.arange(5000) >= 3200).astype(np.int64)

    seen = find_common_time(time + part * missed * PERIOD, part, q, 200.0, [0, 0])
    repetition, common = find_repetition(seen, part, q, 200.0)

    assert repetition.period == pytest.approx(PERIOD, abs=0.01)
    assert (np.diff(common) > 0.0).all()
    off = (repetition.phase(common) - time / PERIOD + 0.5) % 1.0 - 0.5
    np.testing.assert_allclose(off, 0.0, atol=1e-3)


def periodic(effort_step: float = 0.0) -> FilteredData:
    """Return 25 s of the small arm on a path that repeats, without noise."""
    motion = moving(0, 25.0)
    angle = np.outer(motion.time, TURNS)
    q, qd = MIDDLE + HALF * np.sin(angle), HALF * TURNS * np.cos(angle)
    exact = model().torque(q, qd, -HALF * TURNS**2 * np.sin(angle))
    read = effort_step * np.round(exact / effort_step) if effort_step else exact
    return FilteredData.of(load([Recording(ARM.joint_names, motion.time, q, qd, read)], model()))


def test_no_held_out_phase_is_seen_in_another_period():
    data = periodic()
    phase = np.round(data.time % data.repetition.period, 2)

    assert data.repetition.period == pytest.approx(PERIOD, abs=0.01)
    assert data.held_out.sum() > 100
    assert not set(phase[data.fold >= 0]) & set(phase[data.held_out])


def test_a_floor_of_repetition_is_no_less_than_the_steps_of_the_efforts_leave():
    """A motion without noise, read in steps of an effort, returns to the same steps."""
    step, unknown = 0.1, np.full(ARM.n, np.nan)
    data = periodic(step)

    floor = data.noise_rms(unknown)[:3]

    # White up to 50 Hz, of which the band lets through somewhat less than 8 Hz.
    np.testing.assert_allclose(floor, step / np.sqrt(12.0) * np.sqrt(8.0 / 50.0), rtol=0.15)
    repeated = replace(data, motion=replace(data.motion, rounding=np.zeros(ARM.n)))
    assert (repeated.noise_rms(unknown)[:3] < 0.2 * floor).all()


def test_a_measured_motion_read_as_joint_coordinates_is_read_wrongly():
    """A real master arm, whose file has a model of it."""
    measured = Recording.load(
        shared_data("mtm_dynamic_30s_200hz.csv"), coordinates="actuator"
    ).between(0.0, 12.0)

    first = diagnose(replace(measured, coordinates="joint"), MODEL_FILE).findings[0]

    assert first.effect == "wrong_coordinates"
    assert first.gain.relative > 0.2
