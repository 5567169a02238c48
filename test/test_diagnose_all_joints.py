"""What is alike at all joints is one cause, told of all; what is not is told joint by joint."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dvrk_gravity.diagnosis import diagnose
from dvrk_gravity.effects import (
    THE_ARM,
    AllFrictionHypothesis,
    CoulombFriction,
    PreslidingHypothesis,
    Site,
    State,
)
from dvrk_gravity.identification import identify
from testing.lab_effects import payload
from testing.lab_motion import draw_calibration, draw_other
from testing.mujoco_world import MujocoWorld

pytestmark = pytest.mark.usefixtures("brief_simulation")

MORE, LOAD = 1.2, 0.04  # of friction; part of a joint's load that is friction, as gears have it
DURATION = 15.0  # s, of the motion that is diagnosed


@pytest.fixture(scope="module")
def world() -> MujocoWorld:
    drawn = MujocoWorld.draw("ur5", 5)
    loaded = replace(drawn.joint_friction, load=np.full(drawn.arm.n, LOAD))
    return replace(drawn, joint_friction=loaded)


@pytest.fixture(scope="module")
def model(world):
    calibration = world.truth(draw_calibration(world.arm, 5))
    return identify(world.record(calibration, 5), world.arm).model


def warmed(world: MujocoWorld) -> MujocoWorld:
    """The arm on a day on which all that rubs rubs more."""
    friction = world.joint_friction
    more = {name: MORE * getattr(friction, name) for name in ("level", "damping", "load")}
    return replace(world, joint_friction=replace(friction, **more))


def on_a_day(world: MujocoWorld, model, change, duration: float = DURATION):
    """Another motion; its efforts with a change of the model's friction, kind by kind."""
    motion = draw_other(world.arm, 7, draw_calibration(world.arm, 5))
    truth = world.truth(motion, duration)
    state = State(truth.q, truth.qd, truth.qdd)
    kinds = {term.NAME: term.torque(state) for term in model.terms if term.FRICTION}
    return world.record(replace(truth, effort=truth.effort + change(kinds)), 7)


def factors(parameters) -> dict[str, float]:
    return {name.removesuffix("_factor"): each.value for name, each in parameters.items()}


def test_all_friction_that_has_grown_is_known_and_no_scale_of_all_efforts(world, model):
    motion = draw_other(world.arm, 7, draw_calibration(world.arm, 5))
    arm = warmed(world)

    diagnosis = diagnose(arm.record(arm.truth(motion, DURATION), 7), model)

    assert diagnosis.findings == ()
    known = diagnosis.known[0]
    assert known.joints == world.arm.joint_names
    assert "friction than in the model" in known.sentence
    for factor in known.parameters.values():
        assert factor.value == pytest.approx(MORE, abs=0.05)
        assert factor.low < MORE < factor.high


def test_friction_that_has_halved_is_in_the_headline_with_what_to_do_about_it(world, model):
    """Compensated as the model has it, it would drive the arm."""
    recording = on_a_day(world, model, lambda kinds: -0.5 * sum(kinds.values()))

    diagnosis = diagnose(recording, model)

    known, *others = diagnosis.known
    assert diagnosis.verdict == "nothing_to_explain"
    assert "but day-to-day friction variation: there is" in diagnosis.sentence
    assert "% less" in diagnosis.sentence
    ratio = float(known.remedy.split("friction_compensation.ratio ")[1].split()[0])
    assert 0.3 < ratio <= 0.5  # by what surely is there
    assert not [entry for entry in others if "explained by" in entry.sentence]


def test_a_load_on_a_day_of_more_friction_is_told_as_the_load(world, model):
    motion = draw_other(world.arm, 7, draw_calibration(world.arm, 5))
    arm, mass = warmed(world), 0.8
    truth = arm.truth(motion, DURATION)
    centre = np.array([0.02, 0.0, 0.1])
    loaded = payload(arm.setting(truth, np.ones(world.arm.n)), world.arm.n - 1, mass, centre).truth

    diagnosis = diagnose(arm.record(loaded, 7), model)

    (finding,) = diagnosis.findings
    found = finding.parameters["mass"]
    assert (finding.effect, finding.joints) == ("payload", (world.arm.joint_names[-1],))
    assert found.value == pytest.approx(mass, rel=0.1)
    assert found.low < mass < found.high
    known = diagnosis.known[0]
    assert known.joints == world.arm.joint_names
    for factor in known.parameters.values():
        assert factor.low < MORE < factor.high


def test_of_one_kind_that_has_doubled_at_all_joints_the_kind_is_told(world, model):
    recording = on_a_day(world, model, lambda kinds: 1.2 * kinds["viscous_friction"])

    diagnosis = diagnose(recording, model)

    assert diagnosis.findings == ()
    known = diagnosis.known[0]
    found = {name.removesuffix("_factor"): each.value for name, each in known.parameters.items()}
    assert known.joints == world.arm.joint_names
    assert found["viscous_friction"] == pytest.approx(2.2, abs=0.15)
    assert found["coulomb_friction"] == pytest.approx(1.0, abs=0.1)
    assert "more viscous friction than" in known.sentence


def test_a_joint_that_differs_from_the_others_is_told_beside_them(world, model):
    other = 3
    signs = np.where(np.arange(world.arm.n) == other, -0.3, 0.3)

    recording = on_a_day(world, model, lambda kinds: signs * sum(kinds.values()), 30.0)

    diagnosis = diagnose(recording, model)

    assert diagnosis.findings == ()
    for_all, *others = diagnosis.known
    assert for_all.joints == world.arm.joint_names
    factors_of_all = for_all.parameters.values()
    assert np.mean([factor.value for factor in factors_of_all]) == pytest.approx(1.3, abs=0.05)
    assert min(factor.low for factor in factors_of_all) > 1.0
    name = world.arm.joint_names[other]
    (own,) = [each for each in others if each.joints == (name,) and "rms" not in each.parameters]
    assert own.sentence.startswith(f"less friction at {name}, which looks as if")
    assert own.parameters["factor"].high < 1.0


def test_a_scale_of_two_joints_is_not_said_to_be_of_all(world, model):
    scales = np.array([1.0, 0.8, 0.8, 1.0, 1.0, 1.0])
    motion = draw_other(world.arm, 7, draw_calibration(world.arm, 5))
    truth = world.truth(motion, DURATION)

    found = diagnose(world.record(replace(truth, effort=scales * truth.effort), 7), model).findings

    assert [(each.effect, each.joints) for each in found] == [
        ("torque_scale", (world.arm.joint_names[joint],)) for joint in (1, 2)
    ]
    for each in found:
        assert each.parameters["factor"].value == pytest.approx(0.8, abs=0.02)


def test_no_factor_has_friction_drive_the_arm(model):
    hypothesis = AllFrictionHypothesis(
        arm=model.arm, site=THE_ARM, joints=(0, 1), kinds=("coulomb_friction",)
    )
    assert hypothesis.plausible(np.array([-1.0]))
    assert not hypothesis.plausible(np.array([-1.3]))


def test_merged_into_a_model_it_multiplies_the_friction_that_it_has_and_nothing_else(model):
    arm = model.arm
    random = np.random.default_rng(0)
    q, qd, qdd = random.uniform(-0.5, 0.5, (3, 30, arm.n))
    state = State(q, qd, qdd)
    hypothesis = next(
        each
        for each in CoulombFriction.hypotheses(_Motion(model, q, qd))
        if isinstance(each, AllFrictionHypothesis)
    )

    values = hypothesis.merge(model.parameters(), np.array([MORE - 1.0]), _Motion(model, q, qd))
    merged = type(model).from_parameters(values, arm)

    for before in model.terms:
        factor = MORE if before.FRICTION else 1.0
        after = merged.term(before.NAME).torque(state)
        assert after == pytest.approx(factor * before.torque(state)), before.NAME

    none = hypothesis.merge(model.parameters(), np.array([-1.001]), _Motion(model, q, qd))
    assert type(model).from_parameters(none, arm).term("coulomb_friction") is None


class _Motion:
    """What the hypotheses of friction ask of a motion."""

    static, direction = False, None

    def __init__(self, model, q, qd) -> None:
        self.model, self.arm, self.q, self.qd = model, model.arm, q, qd
        self.moves = self.present = np.ones(model.arm.n, dtype=bool)
        state = State(q, qd)
        self.friction = sum(term.torque(state) for term in model.terms if term.FRICTION)

    def slowest(self, row):
        return 0.01

    def sign(self, row, transition=None):
        return np.sign(self.qd @ row)


def test_merged_after_an_element_of_presliding_it_leaves_that_as_it_was_found(model):
    arm = model.arm

    def with_element(model, joint: int, level: float, length: float):
        element = PreslidingHypothesis(
            arm=arm, site=Site.joint(joint), joints=(joint,), setting={"length": length},
            shortest=length,
        )  # fmt: skip
        return element.merge(model.parameters(), np.array([level]), None)

    bare = replace(model, terms=tuple(t for t in model.terms if t.NAME != "presliding_hysteresis"))
    has_one = type(model).from_parameters(with_element(bare, 0, 0.3, 0.02), arm)
    random = np.random.default_rng(0)
    motion = _Motion(has_one, *random.uniform(-0.5, 0.5, (2, 30, arm.n)))
    everywhere = next(
        each
        for each in CoulombFriction.hypotheses(motion)
        if isinstance(each, AllFrictionHypothesis)
    )

    values = everywhere.merge(with_element(has_one, 1, 0.2, 0.01), np.array([MORE - 1.0]), motion)

    merged = type(model).from_parameters(values, arm).term("presliding_hysteresis")
    assert merged.displacement == pytest.approx([0.02, 0.01])
    assert merged.joint[:, :2] == pytest.approx(np.diag([MORE * 0.3, 0.2]))
