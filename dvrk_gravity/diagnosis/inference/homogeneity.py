"""Whether a cause is equal at all joints, and whether it is friction that changed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity import effects
from dvrk_gravity.arrays import Array
from dvrk_gravity.diagnosis.data.candidate import Candidate, split
from dvrk_gravity.diagnosis.data.model_error import (
    FRICTION_PART,
    friction_change,
    like_changed_friction,
    like_friction,
)
from dvrk_gravity.diagnosis.inference.cross_validation import CrossValidation

# Part of the square of a cause's torque that one for all joints may miss. Chosen: half, as of
# day-to-day friction variation.
_MISSED = 0.5


class FrictionChange:
    """Separates friction that changed, as at other joints, from causes to be reported."""

    def __init__(self, validation: CrossValidation) -> None:
        """Look at the samples of choice of a validation."""
        self._validation = validation
        self._friction = validation.of_choice(validation.data.friction)
        self._seen: tuple[list[Candidate], Array] | None = None  # beside which, and weights
        self._last = np.zeros(0), np.zeros(0)

    def explains(
        self, candidate: Candidate, theta: Array, beside: Sequence[Candidate]
    ) -> NDArray[np.bool_]:
        """Return (n,) where the torque of (k,) parameters is what friction may have changed by.

        Args:
            candidate: The candidate.
            theta: Its parameters.
            beside: The others; how much friction changed elsewhere shows beside them.
        """
        if not self._friction.any():
            return np.zeros(self._friction.shape[1], dtype=bool)
        change, _ = self._beside(beside)
        torque = self._validation.torque(candidate, theta)
        return self._explained(candidate, torque, change)

    def changed(self, beside: Sequence[Candidate]) -> Array:
        """Return (n,) RMS by which changed friction may be off beside some candidates, N·m.

        Friction that changed did not do so by just what one of them says: where one of them is that
        change, it may be off by as large a part as it changed by at any joint, and by no more than
        from day to day.
        """
        if not beside or not self._friction.any():
            return np.zeros(self._friction.shape[1])
        return self._beside(beside)[1]

    def _beside(self, selected: Sequence[Candidate]) -> tuple[Array, Array]:
        """Return (n,) by what part friction may have changed, and by what RMS torque be off.

        The latter where one of those selected is its change.
        """
        validation = self._validation
        if self._seen is None or not _same(self._seen, selected, validation.weight):
            torques = [
                (candidate, validation.torque(candidate, theta))
                for candidate, theta in split(selected, validation.parameters(selected))
            ]
            error = validation.of_choice(validation.data.residual)
            for candidate, torque in torques:
                if not effects.is_friction(candidate.hypothesis.effect):
                    error = error - np.where(like_friction(torque, self._friction), 0.0, torque)
            change = friction_change(self._friction, error)
            changed = np.zeros(error.shape)
            for candidate, torque in torques:
                changed += np.where(self._explained(candidate, torque, change), torque, 0.0)
            self._seen = list(selected), validation.weight
            rms, friction = (np.sqrt(np.mean(t**2, axis=0)) for t in (changed, self._friction))
            part = np.max(rms / np.where(friction > 0.0, friction, np.inf))
            part = min(part, FRICTION_PART)
            self._last = change, np.where(rms > 0.0, part * friction, 0.0)
        return self._last

    def _explained(self, candidate: Candidate, torque: Array, change: Array) -> NDArray[np.bool_]:
        of_friction = effects.is_friction(candidate.hypothesis.effect)
        return like_changed_friction(torque, self._friction, change, of_friction)


def _same(
    seen: tuple[list[Candidate], Array], selected: Sequence[Candidate], weight: Array
) -> bool:
    """Return whether candidates, and the weights of their fit, are those that were seen last."""
    return seen[1] is weight and list(map(id, seen[0])) == list(map(id, selected))


class Homogeneity:
    """Compares causes that stand for others at several joints with these, each of its own size."""

    def __init__(self, validation: CrossValidation) -> None:
        """Take what compares hypotheses."""
        self._validation = validation
        self._known: dict[tuple[object, ...], Candidate] = {}

    def _pieces(self, candidate: Candidate) -> Candidate:
        free = candidate.hypothesis.unrestricted
        assert free is not None
        if free.key not in self._known:
            self._known[free.key] = self._validation.data.candidate(free)
        return self._known[free.key]

    def _torques(
        self, candidate: Candidate, theta: Array, beside: Sequence[Candidate]
    ) -> tuple[Array, Array]:
        """Return (R, n) torque of the pieces, fitted beside others, and of what is common."""
        together = [*beside, self._pieces(candidate)]
        pieces, own = split(together, self._validation.parameters(together))[-1]
        return self._validation.torque(pieces, own), self._validation.torque(candidate, theta)

    def differ(self, candidate: Candidate, theta: Array, beside: Sequence[Candidate]) -> float:
        """Return what differs from joint to joint over what is common, of squared torques.

        Args:
            candidate: The cause.
            theta: (k,) its parameters.
            beside: The others.
        """
        each, common = self._torques(candidate, theta, beside)
        square = float((common**2).sum())
        return float(((each - common) ** 2).sum()) / square if square > 0.0 else np.inf

    def hold(
        self, candidate: Candidate, theta: Array, beside: Sequence[Candidate], likelihood: float,
        least: Array,
    ) -> bool:  # fmt: skip
        """Return whether a cause is one for all of its joints.

        Not where the same in pieces, each with a size of its own, explains more, and it misses too
        much of these at some joint.

        Args:
            candidate: The cause.
            theta: (k,) its parameters.
            beside: The others.
            likelihood: More than that is clearly more.
            least: (n,) least torque that matters, RMS.
        """
        if self._validation.score([*beside, self._pieces(candidate)]).likelihood <= likelihood:
            return True
        each, common = self._torques(candidate, theta, beside)
        square, missed = (np.mean(torque**2, axis=0) for torque in (each, each - common))
        return not np.any((missed > least**2) & (missed > _MISSED * square))
