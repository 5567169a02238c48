"""A hypothesis with its columns, and how a set of them does."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arm import N_JOINTS
from dvrk_gravity.effects.effect import Hypothesis

Array = NDArray[np.float64]

PENALTY = 4.0  # log-likelihood that a parameter has to bring


@dataclass(frozen=True, eq=False)
class Candidate:
    """A hypothesis with its reduced columns.

    Attributes:
        hypothesis: The claim.
        joints: (m,) indices of the joints that its torque acts on.
        values: (T, m, k) columns of torque at these, as the bench compares them. Most act on one
            joint, and there are thousands of them.
    """

    hypothesis: Hypothesis
    joints: NDArray[np.int_]
    values: Array

    @classmethod
    def of(cls, hypothesis: Hypothesis, columns: Array) -> Candidate:
        """Return a hypothesis with its (T, 7, k) reduced columns."""
        joints = np.flatnonzero(np.any(columns != 0.0, axis=(0, 2)))
        return cls(hypothesis, joints, columns[:, joints])

    def columns(self, rows: NDArray[np.int_] | NDArray[np.bool_] | slice = slice(None)) -> Array:
        """Return (R, 7, k) columns at some samples, by default at all."""
        values = self.values[rows]
        result = np.zeros((len(values), N_JOINTS, self.size))
        result[:, self.joints] = values
        return result

    @property
    def size(self) -> int:
        """Number of linear parameters."""
        return self.values.shape[2]

    @property
    def ridge(self) -> Array:
        """(k,) inverse variances of the parameters before any data."""
        size = self.hypothesis.plausible_size
        return 1.0 / np.square(size) if size else np.zeros(self.size)

    @property
    def cost(self) -> float:
        """Log-likelihood that it has to bring before it is worth having."""
        return PENALTY * (self.size + len(self.hypothesis.refine)) + float(
            np.log(self.hypothesis.searched)
        )

    @property
    def acts(self) -> NDArray[np.bool_]:
        """(7,) joints that its torque acts on."""
        return np.isin(np.arange(N_JOINTS), self.joints)


@dataclass(frozen=True, eq=False)
class Score:
    """How a set of candidates does on samples that each fit has not seen.

    Attributes:
        rms: (7,) out-of-fold error, N·m.
        loss: (blocks,) squared error of each block in units of the weights.
        likelihood: Sum over joints of -n/2 log(mean squared error), costs taken off.
        error: (R, 7) the errors, N·m.
    """

    error: Array
    rms: Array
    loss: Array
    likelihood: float
