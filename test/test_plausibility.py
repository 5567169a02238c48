"""Positions that no joint can have reached, and motions that are believed."""

from __future__ import annotations

import numpy as np
import pytest
from supervisor_loop import ARM

from dvrk_gravity.compensate import DroppedSampleError, MotionCheck, Sample

TIMEOUT = 0.1


class Stream:
    """Feeds a check with samples at a rate."""

    def __init__(self, rate: float = 1000.0) -> None:
        self.check = MotionCheck(ARM)
        self.step = 1.0 / rate
        self.time = 10.0

    def send(self, position, velocity=None, after: float | None = None) -> Sample:
        self.time += self.step if after is None else after
        given = None if velocity is None else np.array(velocity, dtype=float)
        sample = Sample(int(self.time * 1e9), np.array(position, dtype=float), given, None)
        return self.check.check(sample, self.time, TIMEOUT)


def swing(time: float) -> tuple[np.ndarray, np.ndarray]:
    """A lively motion: 1 to 6 rad/s."""
    amplitude, rate = np.array([0.3, 0.3, 0.3, 0.8, 0.8, 0.5, 1.0]), 6.0
    return amplitude * np.sin(rate * time), amplitude * rate * np.cos(rate * time)


@pytest.mark.parametrize("rate", [50.0, 200.0])
def test_one_bad_reading_in_a_fast_motion_is_passed_over(rate):
    stream, rng = Stream(rate), np.random.default_rng(0)
    for k in range(200):
        position = 15.0 / 6.0 * np.sin(6.0 * k / rate) * np.eye(7)[6]
        if k in (60, 130):
            with pytest.raises(DroppedSampleError):
                stream.send(position + 3.0 * rng.choice([-1.0, 1.0]))
        else:
            stream.send(position)


@pytest.mark.parametrize(("rate", "noise"), [(100.0, 0.05), (1000.0, 0.0)])
def test_a_lively_motion_with_encoder_steps_and_noise_is_believed(rate, noise):
    stream, rng = Stream(rate), np.random.default_rng(0)
    steps = np.array([0.0000248, 0.0000315, 0.0000263, 0.0001492, 0.0029606, 0.0029606, 0.0059213])
    for k in range(int(3 * rate)):
        position, velocity = swing(k / rate)
        velocity = velocity + noise * rng.standard_normal(7)
        sample = stream.send(np.round(position / steps) * steps, velocity)
        np.testing.assert_array_equal(sample.velocity, velocity)
    assert not stream.check.doubtful.any()


def test_a_stamp_that_stands_still_allows_no_jump_and_one_that_goes_back_is_judged_elsewhere():
    stream = Stream()
    stream.send([0.0] * 7)
    with pytest.raises(DroppedSampleError):
        stream.send([1.0] * 7, after=0.0)
    stream = Stream()
    stream.send([0.0] * 7)
    stream.send([0.0] * 7)
    stream.send([1.0] * 7, after=-0.5)
    stream.send([0.0] * 7, after=0.5)
