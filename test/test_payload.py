"""A load: at a place that is stated or anywhere likely, with its mass."""

from __future__ import annotations

from dataclasses import replace

import claims
import known_ecm
import numpy as np
import pytest
from robots import UR5
from scipy import stats

from dvrk_gravity.arms import Arm
from dvrk_gravity.diagnosis import CrossValidation, build, diagnose, load
from dvrk_gravity.diagnosis.inference import load_posterior
from dvrk_gravity.effects import (
    Payload,
    PayloadHypothesis,
    Site,
    State,
    heaviest,
    mass_directions,
    place_of,
    place_terms,
    point_mass_directions,
)
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.report import diagnosis_text

PSM = Arm.load("psm")
LINK2 = PSM.body_names.index("link2")


def carried(link: str, mass: float, place: tuple[float, float, float]):
    """Return the torque of a point mass on a link of the small arm."""
    kilogram = Payload(known_ecm.ARM, link, 1.0, np.array(place), known_ecm.ARM.gravity)
    return lambda q, qd, qdd: mass * kilogram.torque(State(q, qd, qdd))


# --- where it is -----------------------------------------------------------------------------


def test_a_place_is_named_by_link_or_joint():
    for joint, link in (("pitch", "link2"), ("insertion", "link3")):
        by_joint, by_link = (place_of(PSM, f"{name}:0.024,0.535,0") for name in (joint, link))
        assert by_joint[0] == by_link[0] == PSM.body_names.index(link)
        np.testing.assert_allclose(by_joint[1], (0.024, 0.535, 0.0))


def test_without_coordinates_it_is_where_the_next_link_is_attached():
    for arm in map(Arm.load, ("psm", "mtmr", "ecm", UR5)):
        body, end = place_of(arm, arm.joint_names[1])
        following = arm.bodies[place_of(arm, arm.joint_names[2])[0]]
        frame = arm.bodies[body].frame
        np.testing.assert_allclose(frame.act(end), following.placement.translation, atol=1e-12)
        np.testing.assert_allclose(place_of(arm, arm.joint_names[-1])[1], 0.0)


def test_a_link_on_a_fixed_joint_is_a_place_on_the_link_that_moves_it():
    ur5 = Arm.load(UR5)
    for text, y in (("tool0", 0.0823), ("tool0:0,0,0.1", 0.1823)):
        body, place = place_of(ur5, text)
        assert ur5.body_names[body] == "wrist_3_link"
        np.testing.assert_allclose(place, (0.0, y, 0.0), atol=1e-9)


@pytest.mark.parametrize(
    "text", ["gripper", "pitch:1,2", "pitch:a,0,0", "pitch:0,3.5,0", "pitch:nan,0,0", ":0,0,0"]
)
def test_a_place_that_is_none_is_refused_in_one_line(text):
    with pytest.raises(ConfigError, match=r"^--payload-at") as refused:
        place_of(PSM, text)
    said = str(refused.value)
    assert "\n" not in said
    if text.split(":")[0] not in PSM.joint_names:
        assert {"link2", "insertion"} <= set(said.replace(",", "").split())
    assert place_of(PSM, "pitch:0,3,0")[1].tolist() == [0.0, 3.0, 0.0]


def test_a_load_that_the_recording_cannot_show_is_refused():
    recording, model = known_ecm.recorded(1, 9.0), known_ecm.model()
    for at, joints in (("link1:0,0,0", 4), ("link2", 3)):
        kept = slice(0, joints)
        few = replace(
            recording, joints=recording.joints[kept], position=recording.position[:, kept],
            velocity=recording.velocity[:, kept], effort=recording.effort[:, kept],
        )  # fmt: skip
        with pytest.raises(ConfigError, match=rf"--payload-at: got '{at}'"):
            build(few, model, {"roll": 0.0} if joints < 4 else {}, payload_at=at)


# --- what it weighs --------------------------------------------------------------------------


def test_a_point_mass_is_quadratic_in_its_place():
    place = np.array([0.02, -0.3, 0.1])
    for body in range(len(PSM.bodies)):
        whole = point_mass_directions(PSM, body) @ place_terms(place[None])[0]
        linear = mass_directions(PSM, body, place) @ [1.0, *place]
        np.testing.assert_allclose(whole, linear, atol=1e-12)


def test_places_are_drawn_from_their_posterior_with_its_evidence():
    """Against draws of the prior, weighted by their likelihood."""
    random, extent = np.random.default_rng(2), 0.4
    columns = np.diag([0.0, 5.0, 5.0, 0.0, 20.0, *[0.0] * 5])
    seen = 0.2 * columns @ place_terms(np.array([[0.3, -0.2, 0.1]]))[0]
    form = load_posterior.LoadLikelihood(columns.T @ columns, columns.T @ seen, 1.0)
    # Half normal in any direction, but within a tenth of the extent any point is as likely.
    ways, distance = random.normal(size=(40_000, 3)), extent * random.normal(size=40_000)
    prior = ways * (distance / np.linalg.norm(ways, axis=1))[:, None]
    core = distance**2 / (distance**2 + (0.1 * extent) ** 2)
    likelihood = np.exp(form.log_likelihood(prior))

    runs = [load_posterior._tempered(form, extent, random) for _ in range(8)]

    expected = np.log(np.average(likelihood, weights=core))
    assert np.mean([evidence for _, evidence in runs]) == pytest.approx(expected, abs=0.05)
    found = np.linalg.norm(np.concatenate([places for places, _ in runs]), axis=1)
    expected = np.average(np.abs(distance), weights=core * likelihood)
    assert found.mean() == pytest.approx(expected, rel=0.05)


def test_at_a_place_the_mass_is_half_normal_before_data_and_integrated():
    """Against sums over a grid of masses."""
    random, plausible, mass = np.random.default_rng(3), 0.7, np.linspace(0.0, 6.0, 60_001)
    root, score = random.normal(size=(10, 10)), random.normal(size=10)
    form = load_posterior.LoadLikelihood(root @ root.T, 3.0 * score, plausible)
    places = 0.5 * random.normal(size=(6, 3))
    terms = place_terms(places)
    linear, square = terms @ form.score, np.sum((terms @ root) ** 2, axis=1)
    rise = linear[:, None] * mass - 0.5 * (square + plausible**-2)[:, None] * mass**2
    density = np.exp(rise) * 2.0 * stats.norm.pdf(0.0, scale=plausible)
    assert (np.argmax(rise, axis=1) == 0).any(), "at some place best without a load"

    whole = np.trapezoid(density, mass, axis=1)
    np.testing.assert_allclose(form.log_likelihood(places), np.log(whole), atol=1e-6)
    np.testing.assert_allclose(form.explained(places), rise.max(axis=1), atol=1e-6)
    np.testing.assert_allclose(form.resolved(places), 1.0 / np.sqrt(square + plausible**-2))
    mean = np.trapezoid(mass * density, mass, axis=1) / whole
    draws = form.draw(np.repeat(places, 20_000, axis=0), random).reshape(len(places), -1)
    assert draws.mean(axis=1) == pytest.approx(mean, rel=0.03)
    assert replace(form, score=-1e3 * terms[0]).draw(places[:1], random) == 0.0, "hardly a load"


def test_a_temperature_rises_until_half_of_the_draws_are_effective_and_no_further_than_wanted():
    value = np.random.default_rng(0).normal(size=1000) * 4.0 - 50.0
    weight = np.exp(load_posterior._next_step(value, 5.0) * value)
    assert weight.sum() ** 2 / np.sum(weight**2) == pytest.approx(500.0, abs=1.0)
    assert load_posterior._next_step(value, 0.01) == 0.01


def test_a_load_beside_what_else_may_be_is_that_of_one_ridge_regression():
    """Of the residual on the load at a place, another cause, and errors that look like the load."""
    place, body, other = {"x": 0.02, "y": -0.03, "z": 0.06}, claims.N - 1, claims.pool()[0]
    payload = PayloadHypothesis(arm=claims.ARM, site=Site.link(body), setting=place)
    data, theta = claims.data(), 0.3 * np.array([1.0, *place.values()])
    load_ = data.candidate(payload)
    noise = claims.problem({0: 0.2}).data.residual
    validation = CrossValidation.of(replace(data, residual=load_.columns() @ theta + noise))
    spread = np.diag([1e-2, 1e-5, 1e-5, 1e-5])
    problem = load_posterior._Problem.of(
        validation, [load_, other], load_, theta, spread, changed=False
    )

    form = problem.form(body)
    terms = place_terms(np.array([list(place.values())]))[0]
    scale = (validation.weight * validation.choice.usable).ravel() * problem.weight
    rows = validation.choice.rows
    columns = (load_.columns(rows) @ theta / 0.3, other.columns(rows)[..., 0],
               *np.moveaxis(load_.columns(rows) @ np.sqrt(spread), 2, 0))  # fmt: skip
    design = np.stack([each.ravel() * scale for each in columns], axis=1)
    target = validation.data.residual[rows].ravel() * scale
    gram = design.T @ design + np.diag([0.0, *other.ridge, *np.ones(4)])
    covariance = np.linalg.inv(gram)
    precision, score = terms @ form.precision @ terms, form.score @ terms
    assert precision == pytest.approx(1.0 / covariance[0, 0], rel=1e-4)
    assert score / precision == pytest.approx((covariance @ design.T @ target)[0], rel=1e-4)
    assert form.plausible == heaviest(claims.ARM)
    assert (problem.weight < 1.0).all(), "samples that are correlated count less"
    for against, mass, sign in ((True, 1.0, 1.0), (True, -1.0, -1.0), (False, -1.0, 1.0)):
        other_load = replace(load_, hypothesis=replace(payload, against_reference=against))
        of = load_posterior._Problem.of(
            validation, [other_load, other], other_load, mass * theta, spread, changed=False
        )
        assert of.sign == sign, "a mass may be taken off since a reference alone"


def test_a_load_is_near_its_link_and_not_too_heavy():
    """A PSM's link 2 is half a metre long, its plausible extent; twice that is likely."""
    free = PayloadHypothesis(arm=PSM, site=Site.link(LINK2), setting=dict.fromkeys("xyz", 0.0))
    for mass, place, likely, possible in (
        (0.105, 0.535, True, True), (0.2, 0.99, True, True), (0.1, 1.5, False, True),
        (0.1, 1.99, False, True), (0.1, 2.01, False, False), (0.0004, 30.0, False, False),
        (4.9, 0.1, True, True), (500.0, 0.1, True, False), (-0.1, 0.1, True, False),
    ):  # fmt: skip
        theta = mass * np.array([1.0, 0.0, place, 0.0])
        assert (free.typical(theta), free.plausible(theta)) == (likely, possible), (mass, place)
    assert not free.typical(np.array([0.0, 0.0, 0.01, 0.0]))
    removed = replace(free, against_reference=True)
    assert removed.plausible(np.array([-0.1, 0.0, -0.01, 0.0])), "a reference may have had more"


def test_a_load_that_fits_best_far_away_is_tried_where_it_is_likely():
    free = PayloadHypothesis(arm=PSM, site=Site.link(LINK2), setting=dict.fromkeys("xyz", 0.0))
    assert free.clamped(0.2 * np.array([1.0, 0.0, 0.8, 0.0])) is None
    there = free.clamped(0.004 * np.array([1.0, 0.0, 5.0, 0.0]))
    assert there.setting == pytest.approx({"x": 0.0, "y": 1.0, "z": 0.0})
    assert there.typical(np.array([0.004]))
    assert there.parameters(np.array([0.1]))["first_moment_y"] == pytest.approx(0.1)
    assert type(there.unclamped) is PayloadHypothesis
    # One that fits as less than nothing, where its weight points.
    taken_off = np.array([-0.1, 0.0, 0.05, 0.0])
    assert free.clamped(taken_off).setting["y"] == pytest.approx(1.0)
    assert replace(free, against_reference=True).clamped(taken_off) is None


def test_a_second_load_becomes_part_of_the_link_that_carries_it():
    motion = load([known_ecm.recorded(1, 9.0)], known_ecm.model())
    free = PayloadHypothesis(
        arm=motion.arm, site=Site.link(motion.arm.body_names.index("link3")),
        setting={"x": 0.01, "y": 0.02, "z": 0.05},
    )  # fmt: skip
    theta = 0.3 * np.array([1.0, 0.01, 0.02, 0.05])
    values = dict(motion.model.parameters())
    for expected in (0.3, 0.6):
        values = free.merge(values, theta, motion)
        model = known_ecm.TorqueModel.from_parameters(values)
        added = motion.torque_at(motion.q, model) - motion.modelled
        wanted = free.regressor(motion) @ theta * expected / 0.3
        np.testing.assert_allclose(added, wanted, atol=1e-9)
    assert values["payload.mass"] == 0.3


# --- found -----------------------------------------------------------------------------------


@pytest.mark.parametrize("mass", [0.0, 0.5])
def test_a_stated_load_is_a_finding_only_where_the_recording_shows_it(mass):
    place = (0.03, 0.15, 0.0)
    recording = known_ecm.recorded(5, 10.0, carried("link2", mass, place))
    at = "link2:" + ",".join(map(str, place))
    found = diagnose(recording, known_ecm.model(), payload_at=at)
    known = [each for each in found.known if each.effect == "payload"]
    (shown,) = [*known, *found.findings]
    assert shown.effect == "payload"
    assert len(known) == (mass == 0.0)
    weighed = shown.parameters["mass"]
    assert weighed.low - 0.03 <= mass <= weighed.high + 0.03
    assert weighed.value == pytest.approx(mass, abs=0.05)
    assert (found.verdict == "nothing_to_explain") == (mass == 0.0)


def test_a_load_that_is_elsewhere_than_stated_is_found_there_and_that_is_said_first():
    torque = carried("link2", 0.5, (0.03, 0.15, 0.0))
    recording = known_ecm.recorded(5, 10.0, torque)
    found = diagnose(recording, known_ecm.model(), payload_at="link2:0.0,-0.3,0.0")
    assert found.misplaced == "link2:0.0,-0.3,0.0"
    assert found.findings[0].effect == "payload"
    weighed = found.findings[0].parameters["mass"]
    assert weighed.low < 0.5 < weighed.high
    assert weighed.value == pytest.approx(0.5, rel=0.4)  # of a load anywhere, its moment is known
    assert found.misplaced in next(iter(diagnosis_text(found)))
