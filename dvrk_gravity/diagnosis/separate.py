"""Where two explanations that agree on the data would part."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dvrk_gravity.diagnosis.candidate import Candidate
from dvrk_gravity.diagnosis.contest import Contest
from dvrk_gravity.quantity import pose, quantity

_POSES = 400


def separation(
    contest: Contest, rest: Sequence[Candidate], mine: Candidate, other: Candidate
) -> str:
    """Return what would tell two hypotheses apart, in words; ``""`` if nothing found does.

    Both are fitted beside the others, then compared at random poses over the joints' whole
    range, with velocities as seen in the recording.

    Args:
        contest: The contest.
        rest: The other accepted effects.
        mine: The hypothesis that was accepted.
        other: The one that could stand in its place.
    """
    bench = contest.bench
    pair = (mine.hypothesis, other.hypothesis)
    told = next((one.told_apart_by for one in pair if one.told_apart_by), "")
    if told or not all(one.of_state for one in pair):
        return told
    motion = bench.motion
    random = np.random.default_rng(0)
    rows = random.integers(len(motion.q), size=_POSES)
    arm = motion.arm
    q = random.uniform(np.maximum(arm.lower, -3.3), np.minimum(arm.upper, 3.3), (_POSES, arm.n))
    anywhere = replace(
        motion,
        q=q,
        qd=motion.qd[rows],
        qdd=motion.qdd[rows],
        effort=motion.effort[rows],
        direction=None if motion.direction is None else motion.direction[rows],
        time=motion.time[rows],
        parts=(slice(0, _POSES),),
    )
    torques = []
    for one in (mine, other):
        theta, _ = contest.fit([*rest, one])
        columns = one.hypothesis.build(anywhere, one.hypothesis.setting)
        torques.append(columns @ theta[-one.size :])
    apart = np.abs(torques[0] - torques[1]) * contest.weight
    where, joint = np.unravel_index(int(np.argmax(apart)), apart.shape)
    unit = arm.joints[joint].effort_unit
    difference = quantity(abs(torques[0][where, joint] - torques[1][where, joint]), unit)
    if apart[where, joint] < 2.0:
        return "they hardly differ anywhere within the joints' limits"
    there = pose(q[where], [one.unit for one in arm.joints])
    return f"at {there} they differ by {difference} on {arm.joint_names[joint]}"
