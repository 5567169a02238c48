"""Planned motions: what they keep, also between points; what they teach; their files; the verb."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import yaml
from support import MODEL_FILE

from dvrk_gravity.__main__ import main
from dvrk_gravity.arms import Arm, build_tree
from dvrk_gravity.effects import State
from dvrk_gravity.errors import ConfigError, PlanError
from dvrk_gravity.model import ModelUncertainty, TorqueModel, coefficients_of
from dvrk_gravity.planning import (
    Basis,
    Box,
    Combination,
    CoverageObjective,
    FourierMotion,
    ModelKnowledge,
    MotionDesign,
    MotionSearch,
    Plan,
    PlanLimits,
    PoseSettings,
    PriorKnowledge,
    Slack,
    SolverSettings,
    condition_number,
    covering_motion,
    design_motion,
    design_poses,
    link_origins,
    load_limits,
    resting_positions,
    series_basis,
    slacks,
    tip,
)
from dvrk_gravity.report import design_text, limits_text

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


# The motion.
def test_a_motion_begins_and_ends_at_rest_where_it_began(mtmr):
    motion = drawn(mtmr, PlanLimits.of(mtmr))
    for moment in (0.0, motion.duration):
        q, qd, qdd = motion.at(moment)
        np.testing.assert_allclose(q, motion.middle, atol=1e-12)
        np.testing.assert_allclose([qd, qdd], 0.0, atol=1e-12)


def test_velocities_and_accelerations_are_the_derivatives_of_positions(mtmr):
    motion, h = drawn(mtmr, PlanLimits.of(mtmr)), 1e-5
    time = np.linspace(0.1, DURATION - 0.1, 333)
    ahead, behind = motion.at(time + h), motion.at(time - h)
    _, qd, qdd = motion.at(time)
    np.testing.assert_allclose((ahead[0] - behind[0]) / (2 * h), qd, atol=1e-7)
    np.testing.assert_allclose((ahead[1] - behind[1]) / (2 * h), qdd, atol=1e-6)


@pytest.mark.parametrize("order", [2, 3, 4])
@pytest.mark.parametrize("seed", range(3))
def test_no_derivative_exceeds_the_bound_that_the_proof_between_points_uses(mtmr, order, seed):
    limits = PlanLimits.of(mtmr)
    motion = drawn(mtmr, limits, seed)
    ramp = motion.basis.ramp
    for within, begin, end in ((True, 0.0, ramp), (False, ramp, DURATION - ramp)):
        values = motion.basis.at(np.linspace(begin, end, 3000)[1:-1], order)[order]
        largest = np.abs(values @ motion.coefficients @ limits.rows.T).max(axis=0)
        assert (largest <= motion.bound(order, limits.rows, within)).all()


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


# What it teaches.
@pytest.mark.parametrize("name", ["ecm", "mtmr"])
def test_the_gradient_of_the_information_is_its_slope_by_every_part_of_the_state(name):
    arm, random = Arm.load(name), np.random.default_rng(0)
    limits = PlanLimits.of(arm)
    prior, weight = PriorKnowledge(arm, limits.lower, limits.upper), np.full(30, 0.3)
    states = [random.uniform(limits.lower, limits.upper, (30, arm.n))]
    states += [random.normal(size=(30, arm.n)) * arm.scale for _ in range(2)]
    value, gradient = prior.gradient(State(*states), weight)

    def information(*at):
        return np.linalg.slogdet(prior.inverse_covariance(State(*at), weight))[1]

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


def test_a_plan_goes_through_all_of_a_wide_joints_range(tmp_path):
    """Friction, mass and inertia show in half of the range as well as in all; a cable does not."""
    wheel = {"name": "roll", "alpha": 90, "a": 0.1, "d": 0, "offset": 0, "lower": -260,
             "upper": 260, "effort_limit": 1}  # fmt: skip
    (tmp_path / "wheel.yaml").write_text(yaml.safe_dump({"name": "wheel", "joints": [wheel]}))
    arm = Arm.load(tmp_path / "wheel.yaml")
    limits, basis = PlanLimits.of(arm), series_basis(40.0)
    motion = design_motion(arm, limits, basis, settings=BRIEF).plan.motion
    way = motion.at(np.linspace(0.0, basis.duration, 500))[0]
    seen, _ = np.histogram(way, np.linspace(limits.lower[0], limits.upper[0], 8 + 1))
    assert seen.min() > 10, seen


@pytest.fixture(scope="module")
def planned(ecm):
    return design_motion(ecm, PlanLimits.of(ecm), series_basis(DURATION), settings=BRIEF)


def test_a_plan_keeps_every_limit_at_a_thousand_points_a_second(planned):
    assert beyond(planned.plan, planned.plan.limits) <= 0.0
    assert all(slack.left >= 0.0 for slack in planned.slacks)


def test_a_plan_teaches_more_than_the_best_of_twenty_random_motions(ecm, planned):
    limits = PlanLimits.of(ecm)
    prior = PriorKnowledge(ecm, limits.lower, limits.upper)
    time = (np.arange(150) + 0.5) * DURATION / 150
    weight, h = np.full(150, DURATION / 150), 1e-4

    def variance(q, qd, qdd) -> float:
        inverse = prior.inverse_covariance(State(q, qd, qdd), weight)
        return float(np.exp(2.0 * np.mean(np.log(prior.errors(inverse)))))

    random = []
    for seed in range(20):
        motion = covering_motion(PlanLimits.of(ecm), DURATION, seed)
        ahead, behind = motion.at(time + h)[1], motion.at(time - h)[1]
        random.append(variance(*motion.at(time), (ahead - behind) / (2 * h)))
    own = variance(*planned.plan.at(time))
    assert own < 0.6 * min(random)
    assert own < 0.4 * np.median(random)


@pytest.mark.parametrize("most", [40, 200])
def test_errors_are_expected_of_the_whole_motion_not_of_the_times_that_the_search_looks_at(
    ecm, most
):
    limits = PlanLimits.of(ecm)
    few = replace(BRIEF, most_samples=most, rounds=1)
    design = design_motion(ecm, limits, series_basis(DURATION), settings=few)
    prior = PriorKnowledge(ecm, limits.lower, limits.upper)
    time = (np.arange(2400) + 0.5) * DURATION / 2400
    whole = prior.inverse_covariance(State(*design.plan.at(time)), np.full(2400, DURATION / 2400))
    expected = [each[3] for each in design.parameters]
    np.testing.assert_allclose(expected, prior.errors(whole), rtol=0.05)


def test_the_same_seed_makes_the_same_plan(ecm, planned):
    again = design_motion(ecm, PlanLimits.of(ecm), series_basis(DURATION), settings=BRIEF)
    np.testing.assert_array_equal(again.plan.motion.coefficients, planned.plan.motion.coefficients)


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
    at_rest = posterior.inverse_covariance(State(q, still, still), weight)
    learnt = posterior.inverse_covariance(State(q, moving, still), weight)
    np.testing.assert_allclose(at_rest, 1.0)
    # 10 s of a torque with 0.1 N·m of noise that is correlated for 0.1 s: 100 independent samples.
    np.testing.assert_allclose(posterior.errors(learnt), 0.01 / np.sqrt(1.0 + 0.0025), rtol=2e-3)


def test_the_condition_number_is_that_of_the_published_exciting_motions(mtmr):
    motion = drawn(mtmr, PlanLimits.of(mtmr), size=0.2)
    assert 1.0 < condition_number(mtmr, motion) < 1e5
    still = FourierMotion(motion.basis, motion.middle, np.zeros_like(motion.coefficients))
    assert condition_number(mtmr, still) > 1e9


# Limits beside the joints' own.
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


def test_the_tip_is_the_last_link_of_the_chain():
    assert [tip(Arm.load(name)) for name in ("mtmr", "ecm")] == ["link7", "link4"]


def test_a_plan_keeps_combinations_and_stays_out_of_boxes(ecm):
    free = PlanLimits.of(ecm)
    link = tip(ecm)
    unbound = design_motion(ecm, free, series_basis(DURATION), settings=BRIEF).plan
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


def test_efforts_stay_within_their_limits_with_the_models_own_band(mtmr):
    """Without the limit the model's efforts would be higher."""
    model = TorqueModel.load(MODEL_FILE).physical()
    free = PlanLimits.of(mtmr)
    rest = resting_positions(free, mtmr, model, np.random.default_rng(0))[0]
    held = np.abs(mtmr.actuator_effort(model.torque(rest)))
    limits = replace(free, effort=np.minimum(free.effort, held + 0.25 * (free.effort - held)))
    few = SolverSettings(draws=4, starts=1, first=6, rounds=2, iterations=6)
    plan = design_motion(mtmr, limits, series_basis(8.0), model, settings=few).plan
    q, qd, qdd = plan.at(np.arange(0.0, plan.duration, FINE))
    torque = mtmr.actuator_effort(model.torque(q, qd, qdd))
    assert (np.abs(torque) <= limits.effort).all()


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


# Ends by its own count.
def test_a_search_that_counts_finds_the_same_motion_however_slow_the_computer(ecm, monkeypatch):
    limits, basis = PlanLimits.of(ecm), series_basis(DURATION)
    of = replace(BRIEF, seconds=np.inf, evaluations=30)

    def found() -> tuple[np.ndarray, list[float]]:
        shares: list[float] = []
        motion = design_motion(ecm, limits, basis, settings=of, report=shares.append).plan
        return motion.at(np.linspace(0.0, DURATION, 50))[0], shares

    quick, shares = found()
    ticks = iter(range(10**9))
    monkeypatch.setattr("time.process_time", lambda: 100.0 * next(ticks))
    slow, _ = found()
    assert np.array_equal(quick, slow)
    assert shares == sorted(shares)
    assert shares[-1] == 1.0


# What is printed.
def test_what_is_known_before_and_after_is_compared_in_one_unit(planned):
    """The smaller one keeps three digits."""
    values = (
        ("mcx(link2)", "kg·m", 0.002, 1.37e-7),
        ("coulomb_friction.joint[yaw]", "N·m", 2.0, 0.03),
    )
    design = replace(planned, parameters=values)
    head, *rows = design_text(design, had_model=False)
    assert head.split()[-2:] == ["prior", "expected"]
    assert rows[0].split()[1:] == ["200", "g·cm", "0.0137", "g·cm"]
    assert rows[1].split()[1:] == ["2.00", "N·m", "0.0300", "N·m"]


# Limits that leave one joint little.
@pytest.mark.parametrize("width", [1e-5, 0.02])  # rad, of the roll's range
def test_a_joint_of_little_room_leaves_the_others_theirs(ecm, width):
    wide = PlanLimits.of(ecm)
    lower, upper = wide.lower.copy(), wide.upper.copy()
    lower[3], upper[3] = 0.1, 0.1 + width
    limits = replace(wide, lower=lower, upper=upper)
    ways = []
    for of in (wide, limits):
        motion = design_motion(ecm, of, series_basis(DURATION), settings=BRIEF).plan.motion
        assert min(each.left for each in slacks(motion, of, ecm)) >= 0.0
        q = motion.at(np.linspace(0.0, DURATION, 2000))[0]
        ways.append(np.ptp(q, axis=0)[:3])
    assert (ways[1] > 0.7 * ways[0]).all()


# Limits that leave nothing.
def test_the_limit_that_is_named_is_the_one_that_is_exceeded_most_by_its_own_size(ecm, monkeypatch):
    """And not by a number that is a speed, an angle or a length."""
    found = [
        Slack("velocity", "yaw", 1.01, -0.9, "rad/s"),
        Slack("position", "insertion", 3.0, -0.02, "m"),
    ]
    monkeypatch.setattr("dvrk_gravity.planning.optimal.slacks", lambda *of: found)
    with pytest.raises(PlanError, match="the position of insertion would have to give 20"):
        design_motion(ecm, PlanLimits.of(ecm), series_basis(DURATION), settings=BRIEF)


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


# Files.
def test_a_plan_that_is_read_again_is_the_same_motion(planned, tmp_path):
    path = tmp_path / "plan.yaml"
    planned.plan.save(path, "a comment")
    again = Plan.load(path)
    time = np.linspace(0.0, DURATION, 55)
    for here, there in zip(planned.plan.at(time), again.at(time), strict=True):
        np.testing.assert_array_equal(here, there)
    np.testing.assert_allclose(again.limits.upper, planned.plan.limits.upper, rtol=1e-12)
    assert again.arm.joint_names == planned.plan.arm.joint_names


@pytest.mark.parametrize(
    ("where", "value", "words"),
    [
        (("kind",), "dance", "kind: got 'dance'"),
        (("motion", "duration"), -1.0, "motion.duration"),
        (("motion", "ramp"), 100.0, "at most half of the duration"),
        (("motion", "middle", "yaw"), "x", "motion.middle.yaw"),
        (("motion", "sine", "yaw"), [1.0], "finite numbers"),
        (("motion", "speed"), 1.0, "motion: got 'speed'"),
        (("limits", "joints", "yaw", "velocity"), 0.0, "a number above 0"),
    ],
)
def test_a_plan_with_a_wrong_entry_is_refused_by_name(planned, tmp_path, where, value, words):
    path = tmp_path / "plan.yaml"
    planned.plan.save(path)
    content = yaml.safe_load(path.read_text())
    entry = content
    for key in where[:-1]:
        entry = entry[key]
    entry[where[-1]] = value
    path.write_text(yaml.safe_dump(content))
    with pytest.raises(ConfigError, match=words) as caught:
        Plan.load(path)
    assert str(caught.value).startswith(str(path))


def test_the_csv_has_positions_and_velocities_at_1_khz(planned, tmp_path):
    path = tmp_path / "motion.csv"
    planned.plan.write_csv(path)
    head, *rows = path.read_text().splitlines()
    assert head.split(",")[:2] == ["time", "yaw.position"]
    assert head.split(",")[-1] == "roll.velocity"
    values = np.array([row.split(",") for row in rows], dtype=float)
    np.testing.assert_allclose(np.diff(values[:, 0]), 1e-3, atol=1e-6)
    assert values[-1, 0] == DURATION
    q, qd, _ = planned.plan.at(values[:, 0])
    np.testing.assert_allclose(values[:, 1:], np.hstack([q, qd]), atol=1e-7)


LIMITS = """
joints:
  yaw: {position: [-20, 30], velocity: 10, effort: 5}
  insertion: {position: [0.05, 0.2], velocity: 0.02}
combinations:
  - {of: {yaw: 1, pitch: -0.5}, position: [-30, 20]}
boxes:
  - {lower: [-1, 0.5, -1], upper: [1, 1, 1]}
"""


def test_limits_are_read_in_degrees_and_metres_and_the_rest_is_the_arms(ecm, tmp_path):
    path = tmp_path / "limits.yaml"
    path.write_text(LIMITS)
    limits, own = load_limits(path, ecm), PlanLimits.of(ecm)
    np.testing.assert_allclose(limits.upper, [np.radians(30), own.upper[1], 0.2, own.upper[3]])
    np.testing.assert_allclose(limits.velocity[[0, 2]], [np.radians(10), 0.02])
    assert limits.velocity[1] == own.velocity[1]
    assert limits.effort[0] == 5.0
    (combination,) = limits.combinations
    assert combination.name == "yaw - 0.5 pitch"
    assert combination.upper == pytest.approx(np.radians(20))
    assert limits.boxes[0].links == ("link4",)


def test_an_mtms_shoulder_and_elbow_stay_limited_together_beside_another_combination(
    mtmr, tmp_path
):
    path = tmp_path / "limits.yaml"
    path.write_text("combinations:\n  - {of: {wrist_pitch: 1, wrist_yaw: 1}, velocity: 30}\n")
    assert [each.name for each in load_limits(path, mtmr).combinations] == [
        "shoulder_pitch + elbow_pitch", "wrist_pitch + wrist_yaw",
    ]  # fmt: skip
    path.write_text("combinations:\n  - {of: {elbow_pitch: 1, shoulder_pitch: 1}, "
                    "position: [0, 30]}\n")  # fmt: skip
    (own,) = load_limits(path, mtmr).combinations
    assert own.upper == pytest.approx(np.radians(30))


@pytest.mark.parametrize(
    ("entry", "degrees"),
    [
        ("{of: {shoulder_pitch: 1, elbow_pitch: 1}, position: [-60, 120]}", (-9, 39, 90)),
        ("{of: {shoulder_pitch: 1, elbow_pitch: 1}, velocity: 30}", (-9, 39, 30)),
        ("{of: {elbow_pitch: 1, shoulder_pitch: 1}, position: [-60, 20]}", (-9, 20, 90)),
        ("{of: {shoulder_pitch: -2, elbow_pitch: -2}, position: [-60, 4], velocity: 40}",
         (-2, 30, 20)),
    ],
)  # fmt: skip
def test_of_a_combination_that_the_arm_limits_itself_the_stricter_limits_hold(
    mtmr, tmp_path, entry, degrees
):
    path = tmp_path / "limits.yaml"
    path.write_text(f"combinations:\n  - {entry}\n")
    (both,) = load_limits(path, mtmr).combinations
    assert np.degrees([both.lower, both.upper, both.velocity]) == pytest.approx(degrees)
    assert load_limits(path, mtmr).pair is not None


def test_a_difference_of_two_joints_is_limited_beside_their_sum(mtmr, tmp_path):
    path = tmp_path / "limits.yaml"
    path.write_text("combinations:\n  - {of: {shoulder_pitch: 1, elbow_pitch: -1}, velocity: 30}\n"
                    "  - {of: {shoulder_pitch: -2, elbow_pitch: 2}, velocity: 40}\n")  # fmt: skip
    limits = load_limits(path, mtmr)
    own, difference = limits.combinations
    assert np.degrees([own.upper, difference.velocity]) == pytest.approx([39, 20])
    assert limits.and_those(PlanLimits.of(mtmr)).combinations == limits.combinations


@pytest.mark.parametrize("lower", [50, 39])
def test_a_combination_that_leaves_nothing_of_the_arms_own_is_refused_by_name(
    mtmr, tmp_path, lower
):
    """Nor a single value, at which nothing moves."""
    path = tmp_path / "limits.yaml"
    path.write_text(
        f"combinations: [{{of: {{shoulder_pitch: 1, elbow_pitch: 1}}, position: [{lower}, 60]}}]"
    )
    words = rf"combinations\[0\].position: got \[{lower}, 60\], expected some of -9 to 39 deg of"
    with pytest.raises(ConfigError, match=words):
        load_limits(path, mtmr)


def test_what_rounding_leaves_of_a_limit_is_shown_as_nothing():
    _, row, _ = limits_text(
        [Slack("velocity", "yaw", 1.0, 2.6e-10, "rad/s"), Slack("position", "yaw", 0.9, 0.1, "rad")]
    )
    assert row.endswith(" 0 deg/s")


def test_a_plan_that_hardly_moves_a_joint_says_so_in_one_line(ecm, planned):
    def said(plan: Plan) -> list[str]:
        design = MotionDesign(plan, (), 1e7, tuple(slacks(plan.motion, plan.limits, ecm)))
        return [line for line in design_text(design, had_model=False) if "teaches" in line]

    plan, size = planned.plan, np.array([1.0, 1.0, 0.005, 0.005])
    assert said(plan) == []
    motion = replace(plan.motion, coefficients=plan.motion.coefficients * size)
    (line,) = said(replace(plan, motion=motion))
    assert all(f"{name} (moves by" in line for name in ecm.joint_names[2:])
    assert ecm.joint_names[0] not in line
    assert "mm" in line  # what slides, in its own unit


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("speeds: 1", "got 'speeds', expected joints, combinations, boxes"),
        ("joints: {yow: {velocity: 1}}", "got 'yow', expected one of yaw, pitch"),
        ("joints: {yaw: {speed: 1}}", "joints.yaw: got 'speed'"),
        ("joints: {yaw: {position: [30, -20]}}", "the lower one first"),
        ("joints: {yaw: {position: [-200, 20]}}", "within the arm's stops"),
        ("joints: {yaw: {velocity: .inf}}", "a finite number"),
        ("joints: {yaw: {effort: 1000}}", "at most the motor's"),
        ("joints: [1]", "joints: got"),
        ("combinations: [{of: {yaw: 1}, velocity: 1}]", "at least two joints"),
        ("combinations: [{of: {yaw: 1, pitch: 1}}]", "position, velocity or acceleration"),
        ("combinations: [{of: {yaw: 1, pitch: 0}, velocity: 1}]", "a factor that is not zero"),
        ("combinations: [{of: {yaw: 1, pitch: 1.0e+300}, velocity: 1}]", "of 1e-06 to 1e+06"),
        ("combinations: [{of: {yaw: -1.0e-300, pitch: 1}, velocity: 1}]", "of 1e-06 to 1e+06"),
        ("combinations: [{of: {yaw: 1, pitch: 1}, position: [1.0e+300, 1.0e+301]}]", "up to 1e+09"),
        ("boxes: [{lower: [-1.0e+300, 0, 0], upper: [1, 1, 1]}]", "numbers up to 1e+09"),
        ("boxes: [{lower: [0, 0, 0], upper: [1, 1, 0]}]", "lower below upper along z"),
        ("boxes: [{lower: [0, 0], upper: [1, 1, 1]}]", "three coordinates"),
        ("boxes: [{lower: [0, 0, 0], upper: [1, 1, 1], links: [elbow]}]", "some of link1"),
    ],
)
def test_a_wrong_entry_of_a_limits_file_is_refused_by_name(ecm, tmp_path, text, words):
    path = tmp_path / "limits.yaml"
    path.write_text(text)
    with pytest.raises(ConfigError) as caught:
        load_limits(path, ecm)
    assert words in str(caught.value)
    assert str(caught.value).startswith(str(path))


# The verb.
def plan(*words: str | Path) -> int:
    return main(["plan", *map(str, words)])


def test_the_verb_writes_plan_picture_and_motion_and_prints_what_it_promises(tmp_path, capsys):
    out, motion = tmp_path / "plan.yaml", tmp_path / "motion.csv"
    words = ("--arm", "ecm", "--duration", 8, "--time", 1)
    assert plan(*words, "--out", out, "--csv", motion) == 0
    printed = capsys.readouterr().out
    for part in ("standard error of", "coulomb_friction.joint[yaw]", "condition number", "used"):
        assert part in printed
    # The tightest limits, how many more there are, and all of them in the file.
    used = [
        line for line in printed.splitlines() if line.endswith(("deg", "mm", "/s", "/s²", "m/s^2"))
    ]
    assert "more, " in printed
    head = [line for line in out.read_text().splitlines() if line.startswith("# ")]
    assert len(head) == 2 + 3 * Arm.load("ecm").n
    assert len(used) < len(head)
    loaded = Plan.load(out)
    assert beyond(loaded, loaded.limits) <= 0.0
    assert out.with_suffix(".png").read_bytes().startswith(b"\x89PNG")
    assert motion.exists()


@pytest.mark.parametrize(("arm", "known"), [("ecm", True), ("config/arms/ecm.yaml", False)])
def test_of_an_arm_from_a_file_the_next_step_names_ros2_control_too(
    tmp_path, monkeypatch, capsys, planned, arm, known
):
    def design(arm, *_, **__):
        return replace(planned, plan=replace(planned.plan, arm=arm))

    monkeypatch.setattr("dvrk_gravity.planning.design_motion", design)
    path = arm if known else Path(__file__).parents[1] / arm
    assert plan("--arm", path, "--out", tmp_path / "plan.yaml") == 0
    assert ("with --action NAME" in capsys.readouterr().out) != known


def test_infeasible_limits_end_the_verb_in_one_line(tmp_path, capsys):
    limits = tmp_path / "limits.yaml"
    limits.write_text("combinations: [{of: {yaw: 1, pitch: 1}, position: [400, 500]}]")
    out = tmp_path / "plan.yaml"
    assert plan("--arm", "ecm", "--limits", limits, "--out", out) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "yaw + pitch" in line
    assert "would have to give" in line
    assert not out.exists()


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("--duration", 3), "--duration: got 3.0, expected 8 to 600"),
        (("--time", 0), "--time: got 0.0"),
        (("--seed", -1), "--seed: got -1"),
        (("--model", MODEL_FILE), "a model of ecm"),
    ],
)
def test_a_wrong_option_is_refused_in_one_line(tmp_path, capsys, words, expected):
    assert plan("--arm", "ecm", "--out", tmp_path / "plan.yaml", *words) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert expected in line


# Poses.
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
            total += prior.inverse_covariance(state, np.full(len(some), 0.5)) - np.eye(len(total))
        return float(np.linalg.slogdet(total)[1])

    count, others = len(path.poses), []
    for seed in range(10):
        found = resting_positions(limits, ecm, None, np.random.default_rng(seed), 10_000)
        others.append(
            information(found[np.random.default_rng(seed).permutation(len(found))[:count]])
        )
    assert information(path.poses) > max(others)


def test_a_plan_of_poses_that_is_read_again_is_the_same(poses, tmp_path):
    path = tmp_path / "plan.yaml"
    poses.plan.save(path)
    again = Plan.load(path)
    time = np.linspace(0.0, poses.plan.duration, 55)
    for here, there in zip(poses.plan.at(time), again.at(time), strict=True):
        np.testing.assert_allclose(here, there, atol=1e-9)
    assert again.limits.boxes == poses.plan.limits.boxes


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("part", 2.0, "at most 1"),
        ("approach", dict.fromkeys(("yaw", "pitch", "insertion", "roll"), 0.0), "ways above 0"),
        ("positions", {"yaw": [], "pitch": [], "insertion": [], "roll": []}, "at least one"),
        ("positions", {"yaw": [0.0]}, "a value"),
    ],
)
def test_poses_with_a_wrong_entry_are_refused_by_name(poses, tmp_path, name, value, words):
    path = tmp_path / "plan.yaml"
    poses.plan.save(path)
    content = yaml.safe_load(path.read_text())
    content["poses"][name] = value
    path.write_text(yaml.safe_dump(content, sort_keys=False))
    with pytest.raises(ConfigError, match=words) as caught:
        Plan.load(path)
    assert f"poses.{name}" in str(caught.value)


def test_too_little_time_for_poses_is_refused(ecm):
    with pytest.raises(PlanError, match="too short for two poses"):
        design_poses(ecm, PlanLimits.of(ecm), 3.0, settings=PoseSettings(candidates=20))


def test_the_verb_plans_poses(tmp_path, capsys):
    out = tmp_path / "plan.yaml"
    assert plan("--arm", "ecm", "--poses", "--duration", 40, "--out", out) == 0
    assert "coulomb_friction.joint[yaw]" in capsys.readouterr().out
    assert len(Plan.load(out).motion.poses) > 2
