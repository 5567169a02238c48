"""The zero of a joint that did not move is no cause: a constant is all that it would show."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dvrk_gravity.diagnosis import load
from dvrk_gravity.effects import JointOffset
from testing.world import COARSE, World

KNOWN = World.draw(3, step=COARSE)


def test_the_zero_of_a_joint_that_did_not_move_is_not_supposed():
    recording = KNOWN.record(3, 4, 10.0, 100.0)
    moved = np.arange(len(recording.joints)) != 3
    still = replace(
        recording,
        position=np.where(moved, recording.position, recording.position[0]),
        velocity=moved * recording.velocity,
    )
    supposed = {
        joint
        for hypothesis in JointOffset.hypotheses(load([still], KNOWN.model()).motion)
        for joint in hypothesis.joints
    }

    assert supposed == set(np.flatnonzero(moved).tolist())
