"""What streams of set points leave in recordings."""

from __future__ import annotations

import numpy as np

from dvrk_gravity.planning import Multisine
from dvrk_gravity.recording import LowPass, check
from dvrk_gravity.simulate import (
    LAGS,
    TIME_CONSTANT,
    PlantFile,
    SimulatedArm,
    record_motion,
    simulate,
)

CUTOFF = 5.65  # Hz, of identification


DT = 1e-3


TRUTH = PlantFile.load("ecm")


def streamed(rate: float, jitter: float, duration: float) -> tuple[np.ndarray, np.ndarray]:
    """Return position and effort at every step of an arm with perfect sensors.

    Commands leave at ``rate``, and arrive late by up to ``jitter``, s.
    """
    sent = np.arange(0.0, duration, 1.0 / rate)
    times = sent + np.random.default_rng(1).uniform(0.0, jitter, len(sent))
    motion = Multisine.draw(TRUTH.model.arm, 3)
    arm = SimulatedArm(TRUTH.plant())
    arm.plant.reset(motion.at(0.0)[0])
    position, effort = [], []
    told = 0
    for _ in range(round(duration / DT)):
        while told < len(times) and times[told] <= arm.plant.time:
            arm.servo_jp(motion.at(told / len(times) * duration)[0])
            told += 1
        arm.step()
        position.append(arm.plant.q)
        effort.append(arm.effort)
    return np.array(position), np.array(effort)


def test_200_samples_a_second_show_the_torque_whatever_the_rate_of_commands() -> None:
    for rate, jitter in ((100.0, 4e-3), (200.0, 0.0)):
        position, effort = streamed(rate, jitter, 4.0)
        every = LowPass(CUTOFF, 1000.0)(effort)[::5]
        sampled = LowPass(CUTOFF, 200.0)(effort[::5])
        inner = slice(100, -100)
        error = np.linalg.norm((sampled - every)[inner], axis=0)
        assert (error < 0.02 * np.linalg.norm(every[inner], axis=0)).all()
    # The arm is behind the commands by the lags and, as each lasts until the next, half a period.
    motion = Multisine.draw(TRUTH.model.arm, 3)
    late = np.arange(1, len(position) + 1) * DT - LAGS * TIME_CONSTANT - 0.5 / 200.0
    expected = motion.at(np.maximum(late, 0.0))[0]
    away = np.abs(position - expected)[1500:].max(axis=0)
    assert (away < 0.02 * TRUTH.model.arm.scale).all()


def test_a_recording_whose_commands_ripple_is_recognised_and_a_smooth_one_is_not() -> None:
    """A stiff servo follows every step; commands come up to 2 ms late, as over a network."""
    truth = PlantFile.load("mtmr_28002")
    late = np.random.default_rng(1).uniform(0.0, 2e-3, 1000)
    for seed, commands in ((2, 199.0), (1, None)):
        motion = Multisine.draw(truth.model.arm, seed)
        arm = SimulatedArm(truth.plant(), truth.sensors, seed)
        arm.plant.reset(motion.at(0.0)[0])

        def follow(arm: SimulatedArm, _: object, motion=motion, commands=commands) -> None:
            time = arm.plant.time
            told = int(time * commands)
            told -= time < told / commands + late[told % len(late)]
            arm.follow(motion.at(max(told, 0) / commands)[0], np.zeros(7))

        if commands is None:
            recording = record_motion(arm, motion, 6.0, 100.0)
        else:
            recording = simulate(arm, follow, 6.0, 200.0)
        kinds = {finding.kind for finding in check(recording)}
        assert ("effort_ripple" in kinds) == (commands is not None), commands
