"""How far the torque of one hypothesis is that of another."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.diagnosis.data.candidate import Candidate
from dvrk_gravity.diagnosis.inference.cross_validation import CrossValidation
from dvrk_gravity.estimation import Regression


@dataclass(frozen=True)
class OverlapSettings:
    """When one hypothesis is another.

    Attributes:
        contained: Part of a torque that may lie outside another's columns. Chosen; see
            `make sensitivity`.
    """

    contained: float = 1e-3


def contains(
    validation: CrossValidation, larger: Candidate, smaller: Candidate, rest: Sequence[Candidate]
) -> bool:
    """Tell whether a larger hypothesis is a smaller one with more parameters."""
    more = larger.size > smaller.size
    return more and overlap(validation, smaller, larger, rest) > 1.0 - OverlapSettings().contained


def spanned(validation: CrossValidation, candidate: Candidate, rest: Sequence[Candidate]) -> bool:
    """Tell whether all torques of a hypothesis are such as those of others together."""
    columns = validation.design([candidate])
    left = validation.regression(rest).residual(columns)
    return float(np.sum(left**2)) <= OverlapSettings().contained * float(np.sum(columns**2))


def overlap(
    validation: CrossValidation, candidate: Candidate, other: Candidate, rest: Sequence[Candidate]
) -> float:
    """Return the part of a hypothesis' torque that another one's columns reproduce.

    Both are taken beside the rest: what that reproduces anyway does not count.
    """
    theta = validation.parameters([*rest, candidate])
    return reproduced(validation, candidate, theta[-candidate.size :], other, rest)[0]


def reproduced(
    validation: CrossValidation,
    candidate: Candidate,
    theta: Array,
    other: Candidate,
    rest: Sequence[Candidate],
) -> tuple[float, Array]:
    """Return which part of a torque another's columns reproduce, and its (k,) parameters there.

    Args:
        validation: The samples.
        candidate: The hypothesis.
        theta: Its parameters.
        other: Another one.
        rest: What both are taken beside.
    """
    base = validation.regression(rest)
    torque = base.residual(validation.design([candidate]) @ theta)
    columns = base.residual(validation.design([other]))
    free = Regression(columns, np.zeros((other.size, other.size)), base.trace)
    found = free.coefficients(torque)
    residual = torque - columns @ found
    return 1.0 - float(residual @ residual) / max(float(torque @ torque), 1e-300), found
