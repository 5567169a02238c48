"""A load's mass: at a place that is stated, and over all places that the data allow."""

from __future__ import annotations

import numpy as np
import pytest

from dvrk_gravity.arms import Arm
from dvrk_gravity.diagnosis.inference import load_posterior
from dvrk_gravity.effects import (
    PayloadHypothesis,
    Site,
    mass_directions,
    place_of,
    place_terms,
    point_mass_directions,
)
from dvrk_gravity.errors import ConfigError


@pytest.mark.parametrize(("joint", "link"), [("pitch", "link2"), ("insertion", "link3")])
def test_a_place_is_named_by_link_or_joint(joint, link):
    psm = Arm.load("psm")
    by_joint, by_link = (place_of(psm, f"{name}:0.024,0.535,0") for name in (joint, link))
    assert by_joint[0] == by_link[0] == psm.body_names.index(link)
    np.testing.assert_allclose(by_joint[1], (0.024, 0.535, 0.0))


@pytest.mark.parametrize("arm", ["psm", "mtmr", "ecm"])
def test_without_coordinates_it_is_where_the_next_link_is_attached(arm):
    arm = Arm.load(arm)
    body, end = place_of(arm, arm.joint_names[0])
    following = arm.bodies[place_of(arm, arm.joint_names[1])[0]]
    frame = arm.bodies[body].frame
    np.testing.assert_allclose(frame.act(end), following.placement.translation, atol=1e-12)
    np.testing.assert_allclose(place_of(arm, arm.joint_names[-1])[1], 0.0)


@pytest.mark.parametrize(
    "text", ["gripper", "pitch:1,2", "pitch:a,0,0", "pitch:0,535,0", "pitch:nan,0,0", ":0,0,0"]
)
def test_a_place_that_is_none_is_refused_in_one_line(text):
    with pytest.raises(ConfigError) as refused:
        place_of(Arm.load("psm"), text)
    said = str(refused.value)
    assert "--payload-at" in said
    assert "\n" not in said
    if text.split(":")[0] not in Arm.load("psm").joint_names:
        assert "link2" in said
        assert "insertion" in said


def test_a_point_mass_is_quadratic_in_its_place():
    arm, place = Arm.load("psm"), np.array([0.02, -0.3, 0.1])
    for body in range(len(arm.bodies)):
        whole = point_mass_directions(arm, body) @ place_terms(place[None])[0]
        linear = mass_directions(arm, body, place) @ [1.0, *place]
        np.testing.assert_allclose(whole, linear, atol=1e-12)


def test_intervals_of_mass_hold_the_mass_whatever_its_place():
    """Weight and inertia about one axis: moments are seen well, the inertia to a tenth."""
    random = np.random.default_rng(0)
    columns = np.zeros((4, 10))
    columns[0, 1] = columns[1, 2] = 1.0 / 0.001  # moments m x, m y, to 1 g·m
    columns[2, [4, 5]] = 1.0 / 0.002  # m (x² + y²), to 2 g·m²
    held, trials = 0, 60
    for _ in range(trials):
        mass, place = random.uniform(0.05, 0.3), 0.4 * random.normal(size=3)
        seen = columns @ place_terms(place[None])[0] * mass + random.normal(size=4)
        form = load_posterior._Form(columns.T @ columns, columns.T @ seen, 5.0)
        places, _ = load_posterior._tempered(form, 0.4, random)
        low, high = np.percentile(form.draw(places, random), [2.5, 97.5])
        held += bool(low <= mass <= high)
    assert held >= 0.9 * trials


def test_a_first_moment_alone_is_no_likely_load():
    """A PSM's link 2 is half a metre long, its plausible extent: 105 g were found at 1.07 of it."""
    psm = Arm.load("psm")
    load = PayloadHypothesis(arm=psm, site=Site.link(psm.body_names.index("link2")))
    for mass, place, likely in ((0.105, 0.535, True), (0.2, 0.99, True), (0.0004, 30.0, False)):
        assert load.likely(mass * np.array([1.0, 0.0, place, 0.0])) == likely
    assert not load.likely(np.array([0.0, 0.0, 0.01, 0.0]))
