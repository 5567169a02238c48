"""Causes that are not linear in their parameters, linearised where they were found.

The columns of a cause that is not linear are secants: times the parameters at which they were built
they are its whole torque. Least squares of secants leave a residual that is orthogonal to them, and
not to the slope of the torque, as at its least squares it has to be: what the model misses, shifted
with the rest of an effort that is late, makes the delay look shorter than it is. Steps along the
slopes (Gauss and Newton) from the parameters of the secants put that right.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.diagnosis.data.candidate import Candidate, split
from dvrk_gravity.diagnosis.data.filtered_data import FilteredData
from dvrk_gravity.diagnosis.inference.cross_validation import CrossValidation
from dvrk_gravity.effects import OwnTangent


@dataclass(frozen=True)
class TangentSettings:
    """How slopes are taken.

    Attributes:
        rounds: One is enough where a secant is nearly a slope. Chosen: a bound on time.
        step: Of central differences, of the largest parameter. Chosen: their error grows with its
            square.
    """

    rounds: int = 3
    step: float = 0.02


def tangents(
    validation: CrossValidation, chosen: Sequence[Candidate]
) -> tuple[CrossValidation, list[Candidate]]:
    """Return a validation in which causes act along their slopes at the fit, and these causes.

    A fit to that yields the parameters of nonlinear least squares; what it leaves is not measured.
    The same where all that was chosen is linear.
    """
    data, found = validation.data, validation.parameters(chosen)
    if not any(candidate.hypothesis.fixed_point for candidate in chosen):
        return validation, list(chosen)
    error = validation.out_of_fold(chosen)
    for _ in range(TangentSettings().rounds):
        curved, result = data.residual, list(chosen)
        for i, (candidate, theta) in enumerate(split(chosen, found)):
            if candidate.hypothesis.fixed_point and theta.any():
                bend, torque = _bend(data, candidate, theta)
                curved = curved + bend @ theta - torque
                result[i] = Candidate.of(candidate.hypothesis, candidate.columns() + bend)
        there = CrossValidation(replace(data, residual=curved))
        there.weigh(error)
        found = there.parameters(result)
    return there, result


def _bend(data: FilteredData, candidate: Candidate, theta: Array) -> tuple[Array, Array]:
    """Return (T, n, k) slopes of a cause's torque by its parameters less its columns.

    And (T, n) its torque less that of its columns. Both of the model's torque alone: how a
    reading of the torque of other causes bends, is left out.
    """

    def torque(parameters: Array) -> Array:
        there = data.candidate(candidate.hypothesis.relinearised(parameters))
        return there.columns() @ parameters

    columns = data.candidate(candidate.hypothesis).columns()
    curved, claim = torque(theta) - columns @ theta, candidate.hypothesis
    own = claim.tangent(data.motion) if isinstance(claim, OwnTangent) else None
    if own is not None:
        return data.reduce(own) - columns, curved
    step = TangentSettings().step * float(np.abs(theta).max())
    slopes = [
        (torque(theta + change) - torque(theta - change)) / (2.0 * step)
        for change in step * np.eye(len(theta))
    ]
    return np.stack(slopes, axis=2) - columns, curved
