"""Friction that builds up over a milliradian after a reversal, falls with speed, grows by load."""

from functools import cache

import numpy as np
import pinocchio as pin
from robots import UR5
from scipy.signal import butter, sosfiltfilt

from dvrk_gravity.arms import Arm
from dvrk_gravity.identification import Evaluation, evaluate, identify
from dvrk_gravity.recording import DEFAULT_CUTOFF, Recording

RATE, GIVES = 125.0, 1.4e-3  # Hz, rad: between two of the settings that a fit chooses from
NOISE = np.array([0.5, 0.5, 0.4, 0.12, 0.12, 0.1])


def moved(seed: int, duration: float) -> Recording:
    """Return a UR5 by Pinocchio, along sines, masses up to 15 % off, with such friction."""
    random, still = np.random.default_rng(seed), np.random.default_rng(1)
    model = pin.buildModelFromUrdf(str(UR5))
    for body in range(1, model.njoints):
        own = model.inertias[body]
        part = still.uniform(0.85, 1.15)
        model.inertias[body] = pin.Inertia(part * own.mass, own.lever, part * own.inertia)
    level, drag, more = (still.uniform(*span, 6) for span in ((0.7, 1.3), (0.7, 1.3), (0.1, 0.4)))
    size = np.array([8.0, 8.0, 5.0, 1.6, 1.6, 1.4])
    time = np.arange(0.0, duration, 1.0 / RATE)
    omega, phase = 2.0 * np.pi * random.uniform(0.04, 0.35, (5, 6)), random.uniform(0, 6.3, (5, 6))
    wave = random.uniform(0.1, 0.35, (5, 6)) * 0.8 / np.sqrt(omega)
    turn = omega * time[:, None, None] + phase
    q = np.array([0.0, -1.2, 1.0, -0.8, 0.3, 0.0]) + (wave * np.sin(turn)).sum(axis=1)
    qd = (wave * omega * np.cos(turn)).sum(axis=1)
    qdd = (-wave * omega**2 * np.sin(turn)).sum(axis=1)
    built = np.zeros_like(q)
    for k, step in enumerate(np.diff(q, axis=0)):
        kept = np.exp(-np.abs(step) / GIVES)
        built[k + 1] = np.sign(step) * (1.0 - kept) + built[k] * kept
    data = model.createData()
    effort = np.array([pin.rnea(model, data, *state) for state in zip(q, qd, qdd, strict=True)])
    effort += 0.05 * np.abs(effort) * built
    effort += size * (level * built * (1.0 + more * np.exp(-((qd / 0.05) ** 2))) + drag * qd)
    effort += NOISE * random.standard_normal(q.shape)
    return Recording(Arm.load(UR5).joint_names, time, q, qd, effort)


@cache
def judged() -> Evaluation:
    return evaluate(identify(moved(1, 60.0), Arm.load(UR5), "joint").model, moved(2, 30.0), "joint")


def test_an_arm_of_such_gears_is_identified_down_to_three_times_its_noise():
    assert max(error.over_floor for error in judged().joints.values()) < 3.0


def test_the_noise_beside_an_error_is_what_the_filter_leaves_of_the_sensors():
    noise = np.random.default_rng(0).standard_normal((200_000, 1))
    left = sosfiltfilt(butter(2, DEFAULT_CUTOFF, fs=RATE, output="sos"), noise, axis=0).std()
    floor = np.array([error.floor for error in judged().joints.values()])
    np.testing.assert_allclose(floor, left * NOISE, rtol=0.1)
