"""What plans promise, over many motions, points, poses and arms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support import MODEL_FILE

from dvrk_gravity.arms import Arm
from dvrk_gravity.effects import State
from dvrk_gravity.errors import PlanError
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.planning import (
    Box,
    Combination,
    FourierMotion,
    MotionSearch,
    PlanLimits,
    PoseSettings,
    PriorKnowledge,
    SolverSettings,
    covering_motion,
    design_motion,
    design_poses,
    resting_positions,
    series_basis,
    tip,
)

BRIEF = SolverSettings(draws=8, starts=1, first=20, rounds=4, iterations=20)


DURATION = 12.0


@pytest.fixture(scope="module")
def ecm() -> Arm:
    return Arm.load("ecm")


@pytest.fixture(scope="module")
def mtmr() -> Arm:
    return Arm.load("mtmr")


def drawn(arm: Arm, limits: PlanLimits, seed: int = 0, size: float = 0.1) -> FourierMotion:
    """Return a motion that nobody asks to keep anything."""
    basis, random = series_basis(DURATION), np.random.default_rng(seed)
    waves = size * random.normal(size=(2 * len(basis.frequency), arm.n))
    return FourierMotion(basis, 0.5 * (limits.lower + limits.upper), waves)


def test_no_derivative_exceeds_the_bound_that_the_proof_between_points_uses(mtmr):
    limits = PlanLimits.of(mtmr)
    for seed in range(2):
        motion = drawn(mtmr, limits, seed)
        ramp = motion.basis.ramp
        for within, begin, end in ((True, 0.0, ramp), (False, ramp, DURATION - ramp)):
            for order in (2, 3, 4):
                values = motion.basis.at(np.linspace(begin, end, 3000)[1:-1], order)[order]
                largest = np.abs(values @ motion.coefficients @ limits.rows.T).max(axis=0)
                assert (largest <= motion.bound(order, limits.rows, within)).all(), (order, within)


@pytest.fixture(scope="module")
def planned(ecm):
    return design_motion(ecm, PlanLimits.of(ecm), series_basis(DURATION), settings=BRIEF)


def test_a_plan_teaches_more_than_the_best_of_eight_random_motions(ecm, planned):
    limits = PlanLimits.of(ecm)
    prior = PriorKnowledge(ecm, limits.lower, limits.upper)
    time = (np.arange(150) + 0.5) * DURATION / 150
    weight, h = np.full(150, DURATION / 150), 1e-4

    def variance(q, qd, qdd) -> float:
        gram = prior.gram(State(q, qd, qdd), weight)
        return float(np.exp(2.0 * np.mean(np.log(prior.errors(gram)))))

    random = []
    for seed in range(8):
        motion = covering_motion(PlanLimits.of(ecm), DURATION, seed)
        ahead, behind = motion.at(time + h)[1], motion.at(time - h)[1]
        random.append(variance(*motion.at(time), (ahead - behind) / (2 * h)))
    own = variance(*planned.plan.at(time))
    assert own < 0.6 * min(random)
    assert own < 0.4 * np.median(random)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"combinations": (Combination((("yaw", 1.0), ("pitch", 1.0)), 9.0, 10.0),)},
         r"those of yaw \+ pitch \(516 to 573 deg\) would have to give [\d.]+ deg"),
        ({"boxes": (Box("wall", (-9.0, -9.0, -9.0), (9.0, 9.0, 9.0), ("link4",)),)},
         r"distance of link4 from wall would have to give [\d.]+ m"),
    ],
)  # fmt: skip
def test_limits_that_no_motion_keeps_end_with_which_and_by_how_much(ecm, change, words):
    limits = replace(PlanLimits.of(ecm), **change)
    with pytest.raises(PlanError, match=words):
        MotionSearch(
            series_basis(DURATION), limits, PriorKnowledge(ecm, limits.lower, limits.upper)
        )


@pytest.fixture(scope="module")
def poses(ecm):
    limits, link = PlanLimits.of(ecm), tip(ecm)
    both = Combination((("yaw", 1.0), ("pitch", -0.5)), -0.4, 0.5, 0.6)
    box = Box("panel", (0.1, -5.0, -5.0), (5.0, 5.0, 5.0), (link,))
    limits = replace(limits, combinations=(both,), boxes=(box,))
    few = PoseSettings(candidates=400)
    return design_poses(ecm, limits, 60.0, settings=few)


def test_no_value_between_points_of_poses_exceeds_the_proof(poses):
    path, rows = poses.plan.motion, poses.plan.limits.rows
    time, extra = path.grid(0.05, rows)
    fine = np.arange(0.0, path.duration, 1e-3)
    for k, (coarse, dense) in enumerate(zip(path.at(time), path.at(fine), strict=True)):
        peak = np.abs(dense @ rows.T).max(axis=0)
        assert (peak <= (np.abs(coarse @ rows.T) + extra[k]).max(axis=0) + 1e-12).all()


def test_chosen_poses_teach_more_than_as_many_random_ones(ecm, poses):
    limits, path = poses.plan.limits, poses.plan.motion
    prior = PriorKnowledge(ecm, limits.lower, limits.upper)

    def information(some) -> float:
        rest, total = np.zeros_like(some), np.eye(prior.rows.shape[1])
        for direction in (1.0, -1.0):
            state = State(some, rest, rest, np.full(some.shape, direction))
            total += prior.gram(state, np.full(len(some), 0.5))
        return float(np.linalg.slogdet(total)[1])

    count, others = len(path.poses), []
    for seed in range(10):
        found = resting_positions(limits, ecm, None, np.random.default_rng(seed), 10_000)
        others.append(
            information(found[np.random.default_rng(seed).permutation(len(found))[:count]])
        )
    assert information(path.poses) > max(others)


def test_a_search_that_counts_finds_the_same_motion_again(ecm):
    limits, basis = PlanLimits.of(ecm), series_basis(DURATION)
    of = replace(BRIEF, seconds=np.inf, evaluations=10)
    shares: list[float] = []
    first, again, other = (
        design_motion(ecm, limits, basis, None, seed, of, shares.append).plan.motion
        for seed in (1, 1, 2)
    )
    np.testing.assert_array_equal(first.coefficients, again.coefficients)
    assert not np.allclose(first.coefficients, other.coefficients)
    once = shares[: len(shares) // 3]
    assert once == sorted(once)
    assert shares[-1] == 1.0


def test_an_effort_that_does_not_hold_the_arm_ends_with_by_how_much(mtmr):
    model = TorqueModel.load(MODEL_FILE).physical()
    limits = PlanLimits.of(mtmr)
    effort = limits.effort.copy()
    effort[1] = 1e-4
    narrow = replace(limits, effort=effort, lower=limits.lower.copy(), upper=limits.upper.copy())
    narrow.lower[1], narrow.upper[1] = 0.2, 0.21
    narrow.lower[2], narrow.upper[2] = 0.2, 0.21
    with pytest.raises(PlanError, match=r"shoulder_pitch's motor would have to give [\d.]+ mN"):
        resting_positions(narrow, mtmr, model, np.random.default_rng(0))
