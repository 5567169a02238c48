"""Tilt of the base and zeros of joints: which of them this motion can tell apart, found or not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.diagnosis.candidate import Candidate
from dvrk_gravity.diagnosis.cross_validation import CrossValidation
from dvrk_gravity.diagnosis.findings import Ambiguity, Contender
from dvrk_gravity.diagnosis.held_out import HeldOut, estimates
from dvrk_gravity.diagnosis.motion import MeasuredMotion
from dvrk_gravity.diagnosis.overlap import reproduced
from dvrk_gravity.diagnosis.selection import SelectionSettings
from dvrk_gravity.diagnosis.words import told
from dvrk_gravity.units import pose, quantity

_DEGREE = np.pi / 180.0


@dataclass(frozen=True)
class AmbiguitySettings:
    """When two cannot be told apart.

    Attributes:
        same: Part of one's torque that the other reproduces. Chosen.
        poses: Drawn, among which one is looked for that would tell. Chosen: a bound on time.
    """

    same: float = 0.8
    poses: int = 2000


def ambiguities(
    validation: CrossValidation, named: Sequence[Candidate], pool: Sequence[Candidate]
) -> tuple[Ambiguity, ...]:
    """Return pairs of a zero and a tilt, or of two zeros, that this data cannot tell apart.

    What was found already lists what could stand in its place; this is about the others, which
    may be there unseen.

    Args:
        validation: The validation.
        named: The selected effects.
        pool: All hypotheses that need no search.
    """
    validation.weigh(validation.out_of_fold(named), final=True)
    found = {candidate.hypothesis.key for candidate in named}
    free = [
        candidate
        for candidate in pool
        if candidate.hypothesis.key not in found and candidate.acts.any()
    ]
    aligned = [candidate for candidate in free if candidate.hypothesis.alignment]
    zeros = [candidate for candidate in aligned if candidate.size == 1]
    tilts = [candidate for candidate in aligned if candidate.size > 1]
    poses = _poses(validation.data.motion)
    result, seen = [], set()
    for zero in zeros:
        for other in (*tilts, *zeros):
            pair = frozenset((zero.hypothesis.key, other.hypothesis.key))
            if other is zero or pair in seen:
                continue
            share, theta = reproduced(validation, zero, np.array([_DEGREE]), other, named)
            if share > AmbiguitySettings().same:
                seen.add(pair)
                result.append(_ambiguity(validation, named, zero, other, share, theta, poses))
    return tuple(sorted(result, key=lambda ambiguity: -ambiguity.overlap))


def _ambiguity(
    validation: CrossValidation,
    named: Sequence[Candidate],
    zero: Candidate,
    other: Candidate,
    share: float,
    theta: Array,
    poses: MeasuredMotion,
) -> Ambiguity:
    fitted_together = _estimates(validation, named, (zero, other))
    contenders = []
    held_out = HeldOut(validation)
    without, before = validation.score(named), held_out.rmse(held_out.error(named))
    for candidate, together in zip((zero, other), fitted_together, strict=True):
        (alone,) = _estimates(validation, named, (candidate,))
        score = validation.score([*named, candidate])
        gain = score.likelihood - without.likelihood
        inflation = validation.inflation(score.error, without.error - score.error)
        clearly = SelectionSettings().equal_least * float(np.max(inflation[candidate.acts]))
        after = held_out.rmse(held_out.error([*named, candidate]))
        removed = 1.0 - after / np.where(before > 0.0, before, 1.0)
        best = int(np.argmax(removed))
        contenders.append(
            Contender(
                candidate.hypothesis.effect, candidate.hypothesis.names, alone, together, gain,
                gain > clearly,
                validation.data.motion.arm.joint_names[best], float(removed[best]),
            )
        )  # fmt: skip
    pair = f"{zero.hypothesis.subject} and {other.hypothesis.subject}"
    ambiguity = Ambiguity(contenders[0], contenders[1], share, pair, "")
    if ambiguity.suspected:
        sizes = " against ".join(_numbers(contender) for contender in contenders)
    else:
        gains = " and ".join(f"{contender.gain:+.0f}" for contender in contenders)
        clear = "clear " if any(contender.gain > 0.0 for contender in contenders) else ""
        sizes = f"there is no {clear}sign of either (log-likelihood {gains} on unseen blocks)"
    sentence = (
        f"{pair} cannot be told apart here: {100 * share:.0f} % of the torque of the first is the "
        f"second's as well; {sizes}; {_pose(validation, zero, other, theta, poses)}"
    )
    return replace(ambiguity, sentence=sentence)


def _numbers(contender: Contender) -> str:
    alone, together = (
        ", ".join(f"{name} {told(contender.effect, name, value)}" for name, value in values.items())
        for values in (contender.alone, contender.together)
    )
    removed = round(100 * contender.removed, 1) + 0.0
    return (
        f"{alone} alone ({together} beside the other; log-likelihood {contender.gain:+.0f} on "
        f"unseen blocks, {removed:.1f} % of the held-out error at {contender.at})"
    )


def _estimates(
    validation: CrossValidation, named: Sequence[Candidate], candidates: Sequence[Candidate]
) -> list[dict]:
    theta, covariance = validation.fit([*named, *candidates])
    sizes = [
        sum(candidate.size for candidate in named),
        *(candidate.size for candidate in candidates),
    ]
    return [
        estimates(candidate.hypothesis, theta[a:b], covariance[a:b, a:b], {})
        for candidate, (a, b) in zip(candidates, pairwise(np.cumsum(sizes).tolist()), strict=True)
    ]


def _poses(motion: MeasuredMotion) -> MeasuredMotion:
    """Return static poses all over the range of the arm."""
    arm, random, poses = motion.arm, np.random.default_rng(0), AmbiguitySettings().poses
    q = random.uniform(np.maximum(arm.lower, -3.3), np.minimum(arm.upper, 3.3), (poses, arm.n))
    still = np.zeros_like(q)
    return replace(
        motion, q=q, qd=still, qdd=still, effort=still, time=np.arange(float(poses)),
        direction=None if motion.direction is None else np.ones_like(q),
        parts=(slice(0, poses),), rate=None,
    )  # fmt: skip


def _pose(
    validation: CrossValidation,
    zero: Candidate,
    other: Candidate,
    theta: Array,
    poses: MeasuredMotion,
) -> str:
    """Return in which pose one degree of zero differs most from what mimics it in the motion."""
    arm = poses.arm
    torque_of_zero = zero.hypothesis.regressor(poses) @ np.array([_DEGREE])
    torque_of_other = other.hypothesis.regressor(poses) @ theta
    apart = np.abs(torque_of_zero - torque_of_other)
    where, joint = np.unravel_index(int(np.argmax(apart * validation.weight)), apart.shape)
    there = pose(poses.q[where], arm.units)
    return (
        f"held still at {there}, a zero one degree off and what looks like it here differ by "
        f"{quantity(apart[where, joint], arm.joints[joint].effort_unit)} on "
        f"{arm.joint_names[joint]}"
    )
