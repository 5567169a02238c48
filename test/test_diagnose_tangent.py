"""Causes that are not linear are told as nonlinear least squares has them."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from robots import UR5
from scipy.optimize import minimize_scalar

from dvrk_gravity.arms import Arm
from dvrk_gravity.diagnosis import Candidate, CrossValidation, FilteredData, load, refined, tangents
from dvrk_gravity.effects import THE_ARM, DelayHypothesis, TorqueOffset
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.recording import LowPass, Recording

ARM = Arm.load(UR5)
MODEL = TorqueModel(ARM, TorqueModel.stated(ARM).terms)
DELAY, MISSED = 0.04, 0.5  # s; part of all that is faster than SLOW, which the model has too much
SLOW = 0.6  # Hz


def shifted(values: NDArray[np.float64], time: NDArray[np.float64], delay: float):
    """Return (N, n) values a delay later."""
    return np.stack([np.interp(time - delay, time, column) for column in values.T], axis=1)


@pytest.fixture(scope="module")
def validation() -> CrossValidation:
    """Of an arm that takes less of what is fast than its model says, and efforts that are late."""
    time, random = np.arange(0.0, 30.0, 0.01), np.random.default_rng(0)
    slow, fast = 0.5 + 0.17 * np.arange(ARM.n), 5.0 + 0.7 * np.arange(ARM.n)
    q = np.sin(slow * time[:, None]) + 0.1 * np.sin(fast * time[:, None] + np.arange(ARM.n))
    qd = np.gradient(q, time, axis=0)
    torque = MODEL.torque(q, qd, np.gradient(qd, time, axis=0))
    taken = torque - MISSED * (torque - LowPass(SLOW, 100.0)(torque))
    effort = shifted(taken, time, DELAY) + 0.05 * random.normal(size=q.shape)
    recording = Recording(ARM.joint_names, time, q, qd, effort)
    return CrossValidation.of(FilteredData.of(load([recording], MODEL).motion))


def least_squares(validation: CrossValidation) -> float:
    """Return the delay of the model's torque that leaves least of the samples of choice, s."""
    data = validation.data
    measured = data.reduce(data.motion.effort)

    def cost(delay: float) -> float:
        late = data.reduce(shifted(data.motion.modelled, data.motion.time, delay))
        return float(np.sum((validation.of_choice(measured - late) * validation.weight) ** 2))

    return float(minimize_scalar(cost, bounds=(0.0, 0.2), method="bounded").x)


class Sharp(DelayHypothesis):
    """The model's torque as it is, late: in one form alone, that of :func:`least_squares`."""

    alternative_form = None


def by_secants(validation: CrossValidation) -> tuple[CrossValidation, Candidate]:
    """Return the delay at the setting that its own fit tells."""
    motion = validation.data.motion
    hypothesis = Sharp(arm=motion.arm, site=THE_ARM, setting={"delay": 0.0})
    found = refined(validation, validation.data.candidate(hypothesis), [])
    return validation.weighted([found]), found


def test_a_delay_is_that_of_least_squares_though_the_model_misses_what_is_fast(validation):
    validation, secants = by_secants(validation)
    there, (along,) = tangents(validation, [secants])
    (delay,), (by_secant,) = there.parameters([along]), validation.parameters([secants])

    assert delay == pytest.approx(least_squares(validation), rel=0.01)
    assert abs(delay - DELAY) < 0.5 * abs(by_secant - DELAY)


def test_what_is_linear_stays_as_it_is(validation):
    motion = validation.data.motion
    constant = validation.data.candidate(next(TorqueOffset.hypotheses(motion)))

    assert tangents(validation, [constant]) == (validation, [constant])
