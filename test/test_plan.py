"""Planned motions: what they keep, also between points, and what they teach; poses, too."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from dvrk_gravity.arms import Arm, build_tree
from dvrk_gravity.effects import State
from dvrk_gravity.model import ModelUncertainty, TorqueModel, coefficients_of
from dvrk_gravity.planning import (
    Basis,
    Box,
    Combination,
    CoverageObjective,
    FourierMotion,
    ModelKnowledge,
    PlanLimits,
    PoseSettings,
    PriorKnowledge,
    SolverSettings,
    design_motion,
    design_poses,
    link_origins,
    series_basis,
    slacks,
    tip,
)

BRIEF = SolverSettings(draws=8, starts=1, first=20, rounds=4, iterations=20)
DURATION = 12.0
FINE = 1e-3  # s: what is sent to an arm


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


def beyond(motion, limits: PlanLimits) -> float:
    """Return by how much a motion exceeds the limits of positions and rates at 1 kHz; 0 or less."""
    time = np.arange(0.0, motion.duration, FINE)
    q, qd, qdd = (each @ limits.rows.T for each in motion.at(time))
    lower, upper = limits.range
    velocity, acceleration = limits.rates
    return max(
        (lower - q).max(), (q - upper).max(), (np.abs(qd) - velocity).max(),
        (np.abs(qdd) - acceleration).max(),
    )  # fmt: skip


# --- the motion


def test_velocities_and_accelerations_are_the_derivatives_of_positions(mtmr):
    motion, h = drawn(mtmr, PlanLimits.of(mtmr)), 1e-5
    time = np.linspace(0.1, DURATION - 0.1, 333)
    ahead, behind = motion.at(time + h), motion.at(time - h)
    _, qd, qdd = motion.at(time)
    np.testing.assert_allclose((ahead[0] - behind[0]) / (2 * h), qd, atol=1e-7)
    np.testing.assert_allclose((ahead[1] - behind[1]) / (2 * h), qdd, atol=1e-6)


def test_a_waves_crest_between_two_points_of_the_grid_counts(ecm):
    """A limit just below the crest, which lies between points of the check's grid."""
    limits = PlanLimits.of(ecm)
    basis = Basis(np.array([0.6]), 1.0, 8.0)
    waves = np.zeros((2, ecm.n))
    waves[:, 0] = 0.02, 0.1
    motion = FourierMotion(basis, 0.5 * (limits.lower + limits.upper), waves)
    crest = np.abs(motion.at(np.linspace(1.0, 7.0, 600_001))[1][:, 0]).max()
    velocity = limits.velocity.copy()
    velocity[0] = crest * (1.0 - 1e-12)
    (speed,) = (
        slack
        for slack in slacks(motion, replace(limits, velocity=velocity), ecm)
        if (slack.limit, slack.of) == ("velocity", ecm.joint_names[0])
    )
    assert speed.left < 0.0


# --- what it teaches


def test_the_gradient_of_the_information_is_its_slope_by_every_part_of_the_state(ecm):
    arm, random = ecm, np.random.default_rng(0)
    limits = PlanLimits.of(arm)
    prior, weight = PriorKnowledge(arm, limits.lower, limits.upper), np.full(30, 0.3)
    states = [random.uniform(limits.lower, limits.upper, (30, arm.n))]
    states += [random.normal(size=(30, arm.n)) * arm.scale for _ in range(2)]
    value, gradient = prior.gradient(State(*states), weight)

    def information(*at):
        gram = prior.gram(State(*at), weight)
        return np.linalg.slogdet(np.eye(len(gram)) + gram)[1]

    assert value == pytest.approx(information(*states))
    for part in range(3):
        way = random.normal(size=states[0].shape) * arm.scale
        sides = [
            information(*(each + sign * 1e-6 * way * (k == part) for k, each in enumerate(states)))
            for sign in (1.0, -1.0)
        ]
        slope = (sides[0] - sides[1]) / 2e-6
        assert np.sum(gradient[part] * way) == pytest.approx(slope, rel=1e-3, abs=1e-4)


def test_the_gradient_of_what_places_teach_is_its_slope_by_positions(ecm):
    limits, random = PlanLimits.of(ecm), np.random.default_rng(0)
    prior, weight = PriorKnowledge(ecm, limits.lower, limits.upper), np.full(30, 0.3)
    everywhere = CoverageObjective(prior, limits.lower, limits.upper)
    q = random.uniform(limits.lower, limits.upper, (30, ecm.n))
    state = State(q, *(np.zeros((30, ecm.n)) for _ in range(2)))
    value, (slope, *_) = everywhere.gradient(state, weight)
    assert value == everywhere.value(state, weight)
    way = random.normal(size=q.shape) * ecm.scale
    ahead, behind = (
        everywhere.value(replace(state, q=q + step * way), weight) for step in (1e-6, -1e-6)
    )
    assert np.sum(slope * way) == pytest.approx((ahead - behind) / 2e-6, rel=1e-3)


def test_what_a_model_knows_is_not_measured_again(ecm):
    """Only the friction of one joint is uncertain: that alone is learnt."""
    limits = PlanLimits.of(ecm)
    values = {"coulomb_friction.joint_positive": (0.5, 0.5, 2.0, 0.01)}
    model = TorqueModel.from_parameters(values, ecm)
    size = len(model.terms[0].theta)
    deviation = np.zeros((size, 1))
    deviation[1] = 0.2
    known = ModelUncertainty(
        coefficients_of(model.terms), {"coulomb_friction": deviation}, np.zeros((4, 1)),
        np.zeros((3, 1)), np.full(4, 0.1), 5.0, np.full(4, 0.1), limits.lower, limits.upper,
        limits.velocity,
    )  # fmt: skip
    posterior = ModelKnowledge(model, known)
    assert posterior.rows.shape[1] == 1
    assert posterior.names == ("coulomb_friction.joint_positive[pitch]",)
    still, moving = np.zeros((10, 4)), np.zeros((10, 4))
    moving[:, 1] = 0.5
    weight = np.full(10, 1.0)
    q = np.tile(0.5 * (limits.lower + limits.upper), (10, 1))
    at_rest = posterior.gram(State(q, still, still), weight)
    learnt = posterior.gram(State(q, moving, still), weight)
    np.testing.assert_allclose(at_rest, 0.0)
    # 10 s of a torque with 0.1 N·m of noise that is correlated for 0.1 s: 100 independent samples.
    np.testing.assert_allclose(posterior.errors(learnt), 0.01 / np.sqrt(1.0 + 0.0025), rtol=2e-3)


@pytest.fixture(scope="module")
def planned(ecm):
    return design_motion(ecm, PlanLimits.of(ecm), series_basis(DURATION), settings=BRIEF)


def test_a_plan_keeps_every_limit_at_a_thousand_points_a_second(planned):
    assert beyond(planned.plan, planned.plan.limits) <= 0.0
    assert all(slack.left >= 0.0 for slack in planned.slacks)


# --- limits beside the joints' own


def test_links_are_where_pinocchio_has_them():
    for name in ("mtmr", "psm", "ecm"):
        arm = Arm.load(name)
        tree = build_tree(arm, {}, arm.gravity)
        q = np.random.default_rng(1).uniform(*arm.range, (5, arm.n))
        found = link_origins(arm, arm.body_names, q)
        for row, here in zip(q, found, strict=True):
            pin.forwardKinematics(tree.model, tree.data, arm.expand @ row)
            for k, body in enumerate(arm.bodies):
                there = (tree.data.oMi[k + 1] * body.frame).translation
                np.testing.assert_allclose(here[k], there, atol=1e-12)


def test_a_plan_keeps_combinations_and_stays_out_of_boxes(ecm, planned):
    free = PlanLimits.of(ecm)
    link, unbound = tip(ecm), planned.plan
    path = link_origins(ecm, (link,), unbound.at(np.arange(0.0, DURATION, 0.01))[0])[:, 0]
    # Where the free motion's tip is a tenth of its time.
    edge = float(np.quantile(path[:, 0], 0.9))
    box = Box("panel", (edge, -5.0, -5.0), (5.0, 5.0, 5.0), (link,))
    both = Combination((("yaw", 1.0), ("pitch", -0.5)), -0.4, 0.5, 0.6)
    limits = replace(free, combinations=(both,), boxes=(box,))
    plan = design_motion(ecm, limits, series_basis(DURATION), settings=BRIEF).plan
    assert beyond(plan, limits) <= 0.0
    q, _, _ = plan.at(np.arange(0.0, DURATION, FINE))
    assert link_origins(ecm, (link,), q)[:, 0, 0].max() < edge


def test_the_band_of_an_effort_holds_what_the_model_never_explained(ecm):
    limits = PlanLimits.of(ecm)
    values = {"coulomb_friction.joint_positive": (0.5, 0.5, 2.0, 0.01)}
    model = TorqueModel.from_parameters(values, ecm)
    nothing, error = np.zeros((4, 0)), np.array([0.1, 0.2, 0.3, 0.01])
    known = ModelUncertainty(
        coefficients_of(model.terms), {"coulomb_friction": np.zeros((16, 0))}, nothing,
        np.zeros((3, 0)), error, 5.0, error, limits.lower, limits.upper, limits.velocity,
    )  # fmt: skip
    motion = drawn(ecm, limits, size=0.01)
    left = {
        sure: np.array([each.left for each in slacks(motion, limits, ecm, of)
                        if each.limit == "effort"])
        for sure, of in ((True, model), (False, replace(model, uncertainty=known)))
    }  # fmt: skip
    np.testing.assert_allclose(left[True] - left[False], 1.96 * error)


# --- poses


@pytest.fixture(scope="module")
def poses(ecm):
    limits, link = PlanLimits.of(ecm), tip(ecm)
    both = Combination((("yaw", 1.0), ("pitch", -0.5)), -0.4, 0.5, 0.6)
    box = Box("panel", (0.1, -5.0, -5.0), (5.0, 5.0, 5.0), (link,))
    limits = replace(limits, combinations=(both,), boxes=(box,))
    few = PoseSettings(candidates=400)
    return design_poses(ecm, limits, 60.0, settings=few)


def test_poses_are_stood_at_from_both_sides_at_rest(poses):
    path = poses.plan.motion
    assert len(path.poses) >= 6
    for begin, end, index, direction in path.stands:
        for moment in np.linspace(begin, end, 5):
            q, qd, qdd = path.at(moment)
            np.testing.assert_allclose(q, path.poses[int(index)], atol=1e-9)
            np.testing.assert_allclose([qd, qdd], 0.0, atol=1e-9)
        _, before, _ = path.at(begin - 0.1)
        assert (np.sign(before) == direction).all()
    assert path.stands[-1, 1] == pytest.approx(path.duration)
    assert path.duration <= 60.0


def test_the_way_between_poses_keeps_all_limits(ecm, poses):
    limits = poses.plan.limits
    assert beyond(poses.plan, limits) <= 1e-12
    assert all(slack.left >= 0.0 for slack in poses.slacks)
    q, _, _ = poses.plan.at(np.arange(0.0, poses.plan.duration, 0.01))
    assert link_origins(ecm, (tip(ecm),), q)[..., 0].max() < 0.1
