"""One cause for several joints: whether it is the same at each of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.diagnosis.data.candidate import Candidate, split
from dvrk_gravity.diagnosis.inference.cross_validation import CrossValidation


@dataclass(frozen=True)
class AlikeSettings:
    """When causes are not one.

    Attributes:
        missed: Part of the square of a cause's torque that one for all of them may miss. Chosen:
            half, as of friction that is another day's.
    """

    missed: float = 0.5


class Alike:
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
        """Tell whether a cause is one for all of its joints.

        Not where the same in pieces, each with a size of its own, explains more, and it misses too
        much of these at some joint.

        Args:
            candidate: The cause.
            theta: (k,) its parameters.
            beside: The others.
            likelihood: More than that is clearly more.
            least: (n,) torque that is of consequence, RMS.
        """
        if self._validation.score([*beside, self._pieces(candidate)]).likelihood <= likelihood:
            return True
        each, common = self._torques(candidate, theta, beside)
        square, missed = (np.mean(torque**2, axis=0) for torque in (each, each - common))
        return not np.any((missed > least**2) & (missed > AlikeSettings().missed * square))
