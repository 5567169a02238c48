"""Friction of another day is one cause at all joints, and not what they all happen to feel."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dvrk_gravity.diagnosis import diagnose
from dvrk_gravity.effects import CoulombFriction, State
from dvrk_gravity.effects.coulomb_friction import AllFrictionHypothesis
from dvrk_gravity.identification import identify
from testing.lab_motion import draw_calibration, draw_other
from testing.mujoco_world import MujocoWorld

MORE, LOAD = 1.2, 0.04  # of friction; part of a joint's load that is friction, as gears have it


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


def test_all_friction_that_has_grown_is_known_and_no_scale_of_all_efforts(world, model):
    motion = draw_other(world.arm, 7, draw_calibration(world.arm, 5))
    arm = warmed(world)

    diagnosis = diagnose(arm.record(arm.truth(motion), 7), model)

    assert diagnosis.findings == ()
    (known,) = [each for each in diagnosis.known if each.effect == "coulomb_friction"]
    assert known.parameters["factor"].value == pytest.approx(MORE, abs=0.05)
    assert "more friction than in the model" in known.sentence


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
