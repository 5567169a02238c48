"""Where two explanations that agree on the data would part."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dvrk_gravity.diagnosis.candidate import Candidate
from dvrk_gravity.diagnosis.cross_validation import CrossValidation
from dvrk_gravity.units import pose, quantity

_POSES = 400


def separation(
    validation: CrossValidation, rest: Sequence[Candidate], selected: Candidate, other: Candidate
) -> str:
    """Return what would tell two hypotheses apart, in words; ``""`` if nothing found does.

    Both are fitted beside the others, then compared at random poses over the joints' whole
    range, with velocities as seen in the recording.

    Args:
        validation: The validation.
        rest: The other selected effects.
        selected: The hypothesis that was selected.
        other: The one that could stand in its place.
    """
    data = validation.data
    pair = (selected.hypothesis, other.hypothesis)
    told = next((hypothesis.separated_by for hypothesis in pair if hypothesis.separated_by), "")
    if told or not all(hypothesis.extrapolates for hypothesis in pair):
        return told
    motion = data.motion
    if motion.reference is not None:
        return ""  # what acts is known where it was measured, and nowhere else
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
    for candidate in (selected, other):
        theta, _ = validation.fit([*rest, candidate])
        columns = candidate.hypothesis.regressor(anywhere)
        torques.append(columns @ theta[-candidate.size :])
    apart = np.abs(torques[0] - torques[1]) * validation.weight
    where, joint = np.unravel_index(int(np.argmax(apart)), apart.shape)
    unit = arm.joints[joint].effort_unit
    difference = quantity(abs(torques[0][where, joint] - torques[1][where, joint]), unit)
    if apart[where, joint] < 2.0:
        return "they hardly differ anywhere within the joints' limits"
    there = pose(q[where], arm.units)
    return f"at {there} they differ by {difference} on {arm.joint_names[joint]}"
