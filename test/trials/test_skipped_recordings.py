"""Recordings in several coordinates, one of which is left out because it was read before."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from made_up_arm import random_inertias, write

from dvrk_gravity import identify
from dvrk_gravity.arms import Arm, build_tree
from dvrk_gravity.recording import Recording


def test_coordinates_stay_with_their_recordings_where_one_is_skipped(tmp_path):
    coupled = [[1, 0, 0, 0], [0.3, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
    arm = Arm.load(write(tmp_path, {"actuator_to_joint": coupled}))
    tree = build_tree(arm, random_inertias(arm, 0), arm.gravity)
    time = np.arange(0.0, 15.0, 0.01)
    lower, upper = arm.range
    recordings = []
    for seed in range(2):
        random = np.random.default_rng(seed)
        rate, phase = 2.0 * np.pi * random.uniform(0.1, 0.5, 4), random.uniform(0.0, 6.0, 4)
        angle, size = np.outer(time, rate) + phase, 0.35 * (upper - lower)
        q, qd = 0.5 * (lower + upper) + size * np.sin(angle), size * rate * np.cos(angle)
        qdd = -size * rate**2 * np.sin(angle)
        effort = np.array([tree.inverse_dynamics(*each) for each in zip(q, qd, qdd, strict=True)])
        effort += 0.01 * random.normal(size=effort.shape) + 0.1 * np.sign(qd)
        recordings.append(Recording(arm.joint_names, time, q, qd, effort, source=f"{seed}.csv"))
    one, two = recordings
    motor = replace(
        two,
        position=arm.actuator_position(two.position),
        velocity=arm.actuator_position(two.velocity),
        effort=arm.actuator_effort(two.effort),
    )
    terms = ["coulomb_friction"]
    few = identify([one, motor], arm, ["joint", "actuator"], terms)
    more = identify([one, one, motor], arm, ["joint", "joint", "actuator"], terms)
    assert few.held_out == more.held_out
    assert [p.value for p in few.parameters] == [p.value for p in more.parameters]
    assert [w.kind for w in more.warnings].count("duplicate_samples") == 1
