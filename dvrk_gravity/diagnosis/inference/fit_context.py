"""Hypotheses beside which others are tested: what they leave, and what friction is expected to do.

Friction changes from day to day. A hypothesis whose torque is a change of friction as other joints
show is expected; one that stands for several joints must be equal at these.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from dvrk_gravity import effects
from dvrk_gravity.arrays import Array, Mask
from dvrk_gravity.diagnosis.data.candidate import Candidate, Score, split
from dvrk_gravity.diagnosis.data.expectation import FRICTION_PART
from dvrk_gravity.diagnosis.inference.cross_validation import CrossValidation

# Part of the square of a cause's torque that one for all joints may miss. Chosen: half, as of
# day-to-day friction variation.
_MISSED = 0.5
_DEVIATIONS = 2.0  # beyond which a change of friction is reported; a convention
_SHARED = 0.5  # of a torque that scaled friction must reproduce to count as its change. Chosen


@dataclass(frozen=True, eq=False)
class FitContext:
    """Selected hypotheses, with the samples weighted by what they leave.

    Attributes:
        validation: The samples.
        candidates: The hypotheses.
    """

    validation: CrossValidation
    candidates: tuple[Candidate, ...]

    @classmethod
    def of(
        cls, validation: CrossValidation, candidates: Sequence[Candidate], final: bool = False
    ) -> FitContext:
        """Weight the samples by what candidates leave, see ``CrossValidation.weighted``."""
        return cls(validation.weighted(candidates, final), tuple(candidates))

    def without(self, candidate: Candidate) -> FitContext:
        """Return the others, with the same weights."""
        return FitContext(self.validation, tuple(o for o in self.candidates if o is not candidate))

    def extended(self, candidate: Candidate) -> FitContext:
        """Return these and another one, with the same weights."""
        return FitContext(self.validation, (*self.candidates, candidate))

    @cached_property
    def score(self) -> Score:
        """How they do out of fold."""
        return self.validation.score(self.candidates)

    @cached_property
    def fitted(self) -> list[tuple[Candidate, Array]]:
        """Each with its (k,) parameters."""
        return split(self.candidates, self.validation.parameters(self.candidates))

    @cached_property
    def friction(self) -> FrictionChange:
        """By how much friction changed."""
        return FrictionChange.of(self.validation, self.fitted)


@dataclass(frozen=True, eq=False)
class FrictionChange:
    """By how much friction changed beside some hypotheses.

    Attributes:
        friction: (R, n) the model's friction, N·m.
        part: (n,) of its friction by which each joint's may have changed, as others show.
        uncertain: (n,) RMS by which changed friction may be off, N·m. It did not change by just
            what one of the hypotheses says: where one of them is that change, it may be off by as
            large a part as it changed by at any joint, and by no more than from day to day.
    """

    friction: Array
    part: Array
    uncertain: Array

    @classmethod
    def of(
        cls, validation: CrossValidation, fitted: Sequence[tuple[Candidate, Array]]
    ) -> FrictionChange:
        """Take what hypotheses with their parameters leave."""
        friction = validation.of_choice(validation.data.expectation.friction)
        zero = np.zeros(friction.shape[1])
        if not friction.any():
            return cls(friction, zero, zero)
        torques = [(c.hypothesis.effect, validation.torque(c, theta)) for c, theta in fitted]
        error = validation.of_choice(validation.data.residual)
        for effect, torque in torques:
            if not effects.is_friction(effect):
                error = error - np.where(like_friction(torque, friction), 0.0, torque)
        found = cls(friction, friction_change(friction, error), zero)
        changed = sum(
            (np.where(found.explains(effect, torque), torque, 0.0) for effect, torque in torques),
            np.zeros(error.shape),
        )
        rms, size = (np.sqrt(np.mean(torque**2, axis=0)) for torque in (changed, friction))
        part = min(float(np.max(rms / np.where(size > 0.0, size, np.inf))), FRICTION_PART)
        return cls(friction, found.part, np.where(rms > 0.0, part * size, 0.0))

    def explains(self, effect: str, torque: Array) -> Mask:
        """Return (n,) where an effect's (R, n) torque is what friction may have changed by."""
        if not self.friction.any():
            return np.zeros(self.friction.shape[1], dtype=bool)
        of_friction = effects.is_friction(effect)
        return like_changed_friction(torque, self.friction, self.part, of_friction)


def differing(rest: FitContext, candidate: Candidate, theta: Array) -> tuple[float, Array, Array]:
    """Return a cause of several joints beside the same in pieces, each with a size of its own.

    Args:
        rest: The others.
        candidate: The cause.
        theta: (k,) its parameters.

    Returns:
        The likelihood of the pieces, their (R, n) torque, and that of what is common.
    """
    free = candidate.hypothesis.unrestricted
    assert free is not None
    pieces = rest.extended(rest.validation.data.candidate(free))
    each = rest.validation.torque(*pieces.fitted[-1])
    return pieces.score.likelihood, each, rest.validation.torque(candidate, theta)


def variation(rest: FitContext, candidate: Candidate, theta: Array) -> float:
    """Return what differs from joint to joint over what is common, of squared torques."""
    _, each, common = differing(rest, candidate, theta)
    square = float((common**2).sum())
    return float(((each - common) ** 2).sum()) / square if square > 0.0 else np.inf


def homogeneous(
    rest: FitContext, candidate: Candidate, theta: Array, likelihood: float, least: Array
) -> bool:
    """Return whether a cause is one for all of its joints.

    Not where the same in pieces explains more, and it misses too much of these at some joint.

    Args:
        rest: The others.
        candidate: The cause.
        theta: (k,) its parameters.
        likelihood: More than that is clearly more.
        least: (n,) least torque that matters, RMS.
    """
    of_pieces, each, common = differing(rest, candidate, theta)
    square, missed = (np.mean(torque**2, axis=0) for torque in (each, each - common))
    uneven = np.any((missed > least**2) & (missed > _MISSED * square))
    return of_pieces <= likelihood or not uneven


def friction_change(friction: Array, error: Array) -> Array:
    """Return (n,) relative change of each joint's friction that is not worth reporting.

    It is what friction changed by at half of the other joints, those where it changed most, since a
    day changes many and not all of them (a PSM's wrist, not its arm); and at most
    :data:`FRICTION_PART`, both within two standard deviations. Zero without friction.

    Args:
        friction: (R, n) of the model.
        error: (R, n) of the model, without what other causes explain.
    """
    rubbing = friction.any(axis=0)
    square = part_of_friction(error, friction) ** 2
    half = max(int(rubbing.sum()) // 2, 1)
    others = np.where(np.eye(len(square), dtype=bool), 0.0, square)
    elsewhere = np.sqrt(np.mean(np.sort(others, axis=1)[:, -half:], axis=1))
    return np.where(rubbing, _DEVIATIONS * np.minimum(FRICTION_PART, elsewhere), 0.0)


def part_of_friction(torque: Array, friction: Array) -> Array:
    """Return (n,) the factor of (R, n) friction that is closest to a torque, by least squares."""
    square = (friction**2).sum(axis=0)
    return np.asarray((friction * torque).sum(axis=0) / np.where(square > 0.0, square, 1.0))


def like_friction(torque: Array, friction: Array) -> Mask:
    """Return (n,) where a factor of (R, n) friction reproduces most of a torque."""
    square, friction_square = (torque**2).sum(axis=0), (friction**2).sum(axis=0)
    shared = (friction * torque).sum(axis=0) ** 2 > _SHARED * square * friction_square
    return np.asarray(shared & (square > 0.0))


def like_changed_friction(
    torque: Array, friction: Array, most: Array, of_friction: bool = False
) -> Mask:
    """Return (n,) where a torque may be a change of friction since calibration.

    Friction may change in any shape, and a motor's at all of its joints together; another effect
    looks like its change where scaled friction reproduces most of it.

    Args:
        torque: (R, n) of a hypothesis.
        friction: (R, n) of the model.
        most: (n,) see :func:`friction_change`.
        of_friction: The hypothesis is about friction.
    """
    square, friction_square = (torque**2).sum(axis=0), (friction**2).sum(axis=0)
    acts = (square > 0.0) & (friction_square > 0.0)
    if of_friction:
        # Relative to each joint's friction, weighted by it.
        part = np.where(acts, square / np.where(acts, friction_square, 1.0), 0.0)
        return np.asarray(acts & bool((part * part).sum() <= (part * most**2).sum()))
    factor = part_of_friction(torque, friction)
    return np.asarray(acts & like_friction(torque, friction) & (np.abs(factor) <= most))
