"""Friction that grows with what a joint transmits is no change of the joint: a model knows that."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dvrk_gravity.diagnosis import FRICTION_BY_LOAD, diagnose, friction_by_load, load
from dvrk_gravity.identification import identify
from testing.lab_motion import draw_calibration, draw_other
from testing.mujoco_world import MujocoWorld

pytestmark = pytest.mark.usefixtures("brief_simulation")

SEED, GROWS = 3419, 0.05  # of the torque that a joint transmits


@pytest.fixture(scope="module")
def world() -> MujocoWorld:
    drawn = MujocoWorld.draw("chain", SEED)
    by_load = np.full(drawn.arm.n, GROWS)
    return replace(drawn, joint_friction=replace(drawn.joint_friction, load=by_load))


@pytest.fixture(scope="module")
def model(world):
    return identify(world.record(world.truth(draw_calibration(world.arm, SEED)), SEED), world.arm)


def other(world: MujocoWorld, motion: int):
    drawn = draw_other(world.arm, motion, draw_calibration(world.arm, SEED))
    return world.record(world.truth(drawn), motion)


@pytest.mark.parametrize("motion", [0, 1])
def test_a_joint_that_carries_more_than_at_calibration_has_no_other_friction(world, model, motion):
    assert diagnose(other(world, motion), model.model).findings == ()


def test_it_is_the_load_beyond_that_of_calibration_against_the_motion(world, model):
    identified = model.model
    motion = load([other(world, 0)], identified).motion
    samples = identified.uncertainty.calibration
    rigid = replace(identified, terms=tuple(t for t in identified.terms if not t.FRICTION))
    then = np.abs(rigid.torque(samples.q, samples.qd, samples.qdd)).mean(axis=0)
    now = np.abs(rigid.torque(motion.q, motion.qd, motion.qdd))
    fast = np.abs(motion.qd) > 3.0 * np.median(np.abs(motion.qd), axis=0)

    columns = friction_by_load(motion)

    expected = FRICTION_BY_LOAD * (now - then) * np.sign(motion.qd)
    for index, joint in enumerate(np.flatnonzero(motion.moves)):
        rows = fast[:, joint]
        np.testing.assert_allclose(columns[rows, joint, index], expected[rows, joint], atol=1e-9)
        assert not np.delete(columns[:, :, index], joint, axis=1).any()


def test_a_model_that_does_not_know_its_calibration_has_none(world, model):
    bare = replace(model.model, uncertainty=replace(model.model.uncertainty, calibration=None))
    assert friction_by_load(load([other(world, 0)], bare).motion).shape[2] == 0
