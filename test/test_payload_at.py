"""A load's mass: at a place that is stated, and over all places that the data allow."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from conftest import few_folds
from support import MODEL_FILE

from dvrk_gravity.arms import Arm
from dvrk_gravity.diagnosis import build, diagnose
from dvrk_gravity.diagnosis.inference import load_posterior
from dvrk_gravity.effects import (
    Payload,
    PayloadHypothesis,
    Site,
    State,
    mass_directions,
    place_of,
    place_terms,
    point_mass_directions,
)
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.recording import Recording
from dvrk_gravity.report import diagnosis_text
from testing.world import COARSE, World

MASTER = World.draw(3, step=COARSE)
LINK = (
    '<link name="{}"><inertial><mass value="1"/><origin xyz="0 0 0.1"/><inertia ixx="0.02" '
    'iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>'
)
JOINT = (
    '<joint name="{}" type="revolute"><parent link="{}"/><child link="{}"/><origin '
    'xyz="0.1 0.05 0.2"/><axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="9" velocity="1"/>'
    "{}</joint>"
)
NAMED_ALIKE = "".join(
    (
        '<robot name="alike"><link name="base"/>',
        *(LINK.format(name) for name in ("lower", "upper", "hand")),
        JOINT.format("upper", "base", "lower", ""),
        JOINT.format("second", "lower", "upper", ""),
        JOINT.format("third", "upper", "hand", '<mimic joint="second" multiplier="-1"/>'),
        "</robot>",
    )
)


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


def test_a_link_s_end_is_where_any_link_is_attached_and_its_name_goes_before_a_joint_s(tmp_path):
    """A joint may be named as the next link is; what follows a joint is attached as well."""
    (tmp_path / "arm.urdf").write_text(NAMED_ALIKE)
    arm = Arm.load(str(tmp_path / "arm.urdf"))
    body, end = place_of(arm, "upper")
    assert arm.body_names[body] == "upper"
    np.testing.assert_allclose(end, (0.1, 0.05, 0.2), atol=1e-12)


@pytest.mark.parametrize(
    ("at", "joints", "message"),
    [
        ("link1:0,0,0", 7, "a mass there has no torque in this motion"),
        ("link5", 6, "recordings of some joints: record all"),
    ],
)
def test_a_load_that_the_recording_cannot_show_is_not_weighed_without_a_word(at, joints, message):
    model, recording = TorqueModel.load(MODEL_FILE), MASTER.record(3, 4, 9.0, 100.0)
    few = Recording(
        recording.joints[:joints], recording.time, recording.position[:, :joints],
        effort=recording.effort[:, :joints],
    )  # fmt: skip
    with pytest.raises(ConfigError, match=message):
        build(few, model, {} if joints == 7 else {"wrist_roll": 0.0}, payload_at=at)


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


@pytest.mark.parametrize("mass", [0.0, 0.5])
def test_a_stated_load_is_a_finding_only_where_the_recording_shows_it(mass):
    link, place = "link5", np.array([0.0, 0.02, 0.05])
    recording, model = MASTER.record(5, 6, 10.0, 100.0), MASTER.model()
    state = State(recording.position, recording.velocity, np.zeros_like(recording.position))
    load = mass * Payload(model.arm, link, 1.0, place, model.arm.gravity).torque(state)
    at = f"{link}:" + ",".join(map(str, place))
    with few_folds():
        found = diagnose(replace(recording, effort=recording.effort + load), model, payload_at=at)
    known = [each for each in found.known if each.effect == "payload"]
    findings = [each for each in found.findings if each.effect == "payload"]
    (shown,) = [*known, *findings]
    assert len(known) == (mass == 0.0)
    assert shown.parameters["mass"].low <= max(mass, 1e-3) <= shown.parameters["mass"].high + 1e-3
    if mass == 0.0:
        assert found.verdict == "nothing_to_explain"
        assert shown.sentence.endswith("its torque is not significant")
        lines = list(diagnosis_text(found))
        assert sum(line.startswith("stated: ") for line in lines) == 1
