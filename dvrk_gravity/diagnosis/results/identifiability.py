"""What the data cannot separate: competing explanations, and zeros beside tilts, found or not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.diagnosis.data.candidate import Candidate, slices_of
from dvrk_gravity.diagnosis.data.motion import MeasuredMotion
from dvrk_gravity.diagnosis.inference.alternatives import reproduced
from dvrk_gravity.diagnosis.inference.cross_validation import CrossValidation
from dvrk_gravity.diagnosis.inference.held_out import HeldOut
from dvrk_gravity.diagnosis.inference.selection import SELECTION
from dvrk_gravity.diagnosis.results import sentences
from dvrk_gravity.diagnosis.results.findings import Ambiguity, Contender
from dvrk_gravity.diagnosis.results.fitted_hypothesis import FittedHypothesis, estimates
from dvrk_gravity.effects import Estimate
from dvrk_gravity.units import pose, quantity

_DEGREE = np.pi / 180.0
_SAME = 0.8  # of a zero's torque that another must reproduce to be inseparable. Chosen
_POSES = 2000  # among which one is looked for that separates them: a bound on time
_STATES = 400  # likewise for competing explanations


def ambiguities(
    validation: CrossValidation, named: Sequence[Candidate], pool: Sequence[Candidate]
) -> tuple[Ambiguity, ...]:
    """Return pairs of a zero and a tilt, or of two zeros, that this data cannot separate.

    Findings list their own alternatives; this is about others that may be there unseen.

    Args:
        validation: The samples.
        named: The selected effects.
        pool: All hypotheses that need no search.
    """
    validation = validation.weighted(named, final=True)
    found = {candidate.hypothesis.key for candidate in named}
    aligned = [
        candidate
        for candidate in pool
        if candidate.hypothesis.alignment
        and candidate.hypothesis.key not in found
        and candidate.acts.any()
    ]
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
            if share > _SAME:
                seen.add(pair)
                apart = _separating_pose(validation, zero, other, theta, poses)
                result.append(_ambiguity(validation, named, zero, other, share, apart))
    return tuple(sorted(result, key=lambda ambiguity: -ambiguity.overlap))


def _ambiguity(
    validation: CrossValidation,
    named: Sequence[Candidate],
    zero: Candidate,
    other: Candidate,
    share: float,
    apart: str,
) -> Ambiguity:
    fitted_together = _estimates(validation, named, (zero, other))
    contenders, fitted = [], []
    held_out = HeldOut(validation)
    without, before = validation.score(named), held_out.rmse(held_out.error(named))
    for candidate, together in zip((zero, other), fitted_together, strict=True):
        (alone,) = _estimates(validation, named, (candidate,))
        score = validation.score([*named, candidate])
        gain = score.likelihood - without.likelihood
        inflation = validation.inflation(score.error, without.error - score.error)
        largest = float(np.max(inflation[candidate.acts]))
        fitted.append(FittedHypothesis.of(validation, named, candidate, gain / largest))
        after = held_out.rmse(held_out.error([*named, candidate]))
        removed = 1.0 - after / np.where(before > 0.0, before, 1.0)
        best = int(np.argmax(removed))
        contenders.append(
            Contender(
                candidate.hypothesis.effect, candidate.hypothesis.names, alone, together, gain,
                bool(gain > SELECTION.equal_least * largest),
                validation.data.motion.arm.joint_names[best], float(removed[best]),
            )
        )  # fmt: skip
    pair = f"{zero.hypothesis.subject} and {other.hypothesis.subject}"
    sentence = sentences.ambiguity(pair, share, contenders, apart)
    return Ambiguity(contenders[0], contenders[1], share, pair, sentence, tuple(fitted))


def _estimates(
    validation: CrossValidation, named: Sequence[Candidate], candidates: Sequence[Candidate]
) -> list[dict[str, Estimate]]:
    together = [*named, *candidates]
    theta, covariance = validation.fit(together)
    return [
        estimates(candidate.hypothesis, theta[rows], covariance[rows, rows], {})
        for candidate, rows in zip(candidates, slices_of(together)[len(named) :], strict=True)
    ]


def _anywhere(arm: Arm, random: np.random.Generator, count: int) -> Array:
    """Return (count, n) random positions within the joints' limits and a turn."""
    low, high = np.maximum(arm.lower, -3.3), np.minimum(arm.upper, 3.3)
    return random.uniform(low, high, (count, arm.n))


def _poses(motion: MeasuredMotion) -> MeasuredMotion:
    """Return static poses all over the range of the arm."""
    q = _anywhere(motion.arm, np.random.default_rng(0), _POSES)
    still = np.zeros_like(q)
    return replace(
        motion, q=q, qd=still, qdd=still, effort=still, time=np.arange(float(_POSES)),
        direction=None if motion.direction is None else np.ones_like(q),
        parts=(slice(0, _POSES),), rate=None,
    )  # fmt: skip


def _separating_pose(
    validation: CrossValidation,
    zero: Candidate,
    other: Candidate,
    theta: Array,
    poses: MeasuredMotion,
) -> str:
    """Return in which pose one degree of zero differs most from what resembles it in the motion."""
    arm = poses.arm
    torque_of_zero = zero.hypothesis.regressor(poses) @ np.array([_DEGREE])
    torque_of_other = other.hypothesis.regressor(poses) @ theta
    apart = np.abs(torque_of_zero - torque_of_other)
    where, joint = np.unravel_index(int(np.argmax(apart * validation.weight)), apart.shape)
    return (
        f"held still at {pose(poses.q[where], arm.units)}, a zero that is one degree off and what "
        "resembles it here differ by "
        f"{quantity(apart[where, joint], arm.joints[joint].effort_unit)} on "
        f"{arm.joint_names[joint]}"
    )


def separation(
    validation: CrossValidation, rest: Sequence[Candidate], selected: Candidate, other: Candidate
) -> str:
    """Return what would separate two hypotheses, in words; ``""`` if nothing is known to.

    Both are fitted with the rest, then compared at random poses over the joints' whole range, at
    velocities of the recording.

    Args:
        validation: The samples.
        rest: The other selected effects.
        selected: The hypothesis that was selected.
        other: The one that could stand in its place.
    """
    pair = (selected.hypothesis, other.hypothesis)
    stated = next((each.separated_by for each in pair if each.separated_by), "")
    if stated or not all(each.extrapolates for each in pair):
        return stated
    motion = validation.data.motion
    if not validation.data.expectation.predicts:
        return ""
    arm, random = motion.arm, np.random.default_rng(0)
    rows = random.integers(len(motion.q), size=_STATES)
    q = _anywhere(arm, random, _STATES)
    anywhere = replace(motion.at(rows), q=q)
    torques = []
    for candidate in (selected, other):
        theta, _ = validation.fit([*rest, candidate])
        columns = candidate.hypothesis.regressor(anywhere)
        torques.append(columns @ theta[-candidate.size :])
    apart = np.abs(torques[0] - torques[1])
    weighted = apart * validation.weight
    where, joint = np.unravel_index(int(np.argmax(weighted)), apart.shape)
    if weighted[where, joint] < 2.0:
        return "they hardly differ anywhere within the joints' limits"
    difference = quantity(apart[where, joint], arm.joints[joint].effort_unit)
    return f"at {pose(q[where], arm.units)} they differ by {difference} on {arm.joint_names[joint]}"
