"""A narrow motion with more friction than the model's: not all folds agree on its coordinates."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from dvrk_gravity.identification import coordinates_of
from dvrk_gravity.observation import decide_coordinates
from dvrk_gravity.planning import Multisine
from dvrk_gravity.recording import Recording
from dvrk_gravity.simulate import SimulatedArm, record_motion
from testing.hide import hide
from testing.world import COARSE, World


@cache
def narrow() -> tuple[World, Recording]:
    """A plain model predicts a fifth of its torque less badly in the motors' coordinates."""
    world, random = World.draw(12057, step=COARSE), np.random.default_rng([57, 4])
    rubbing, _ = hide(world, "coulomb_friction", random)
    motion = Multisine.draw(world.arm, int(random.integers(1 << 30)))
    part, slow = random.uniform(0.1, 0.3), random.uniform(0.3, 0.6)
    motion = replace(motion, amplitude=part * motion.amplitude, frequency=slow * motion.frequency)
    plant = SimulatedArm(rubbing.plant(), rubbing.sensors, 57, dt=rubbing.step)
    return world, record_motion(plant, motion, random.uniform(9.0, 13.0), 100.0)


def test_a_narrow_motion_with_more_friction_is_not_read_as_the_motors():
    world, recording = narrow()
    decision = coordinates_of(world.model(), [recording], None, {})
    assert decision.coordinates == "joint"
    assert decision.errors.best == "actuator"
    assert coordinates_of(world.model(), [recording], "joint", {}).warnings == ()


def test_where_not_all_folds_agree_the_model_at_hand_must_if_there_is_one():
    world, recording = narrow()
    sizes = {"joint": 0.2, "actuator": 0.1}
    for given, doubted in ((None, 0), ("joint", 1), ("actuator", 0)):
        decision = decide_coordinates(recording, world.arm, given, sizes.__getitem__)
        assert decision.coordinates == (given or "actuator")
        assert len(decision.warnings) == doubted
        alone = decide_coordinates(recording, world.arm, given)
        assert (alone.coordinates, len(alone.warnings)) == (given or "actuator", doubted)
