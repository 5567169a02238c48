"""Accuracy of what an arm's own file states: masses from CAD, or from a scale."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dvrk_gravity.arms import Arm, rigid_body
from dvrk_gravity.effects import Term, base_directions
from dvrk_gravity.model.uncertainty import ModelUncertainty, coefficients_of


@dataclass(frozen=True)
class StatedSettings:
    """Accuracy of what an arm's file states.

    Attributes:
        part: Of a link's plausible mass, and of its mass times its extents, as a standard
            deviation. Chosen: cables, screws and covers that a CAD model does not have.
    """

    part: float = 0.03


@dataclass(frozen=True)
class WeightBounds:
    """When what holds an arm contradicts the masses in its file.

    Attributes:
        least: Part of their weight that holds the arm at least. Masses of real files are off by
            40 %: those of a UR10e's weigh .72 to .88 of what is measured (test/test_weights.py).
        most: Multiple of it at most, likewise, a load apart.
        most_loaded: The same at one pose, where a load is not separable: with its greatest load,
            12.5 kg, a UR10e's shoulder bears 2.1 times its own weight.
    """

    least: float = 0.5
    most: float = 2.0
    most_loaded: float = 2.5


WEIGHT = WeightBounds()


def stated_uncertainty(
    arm: Arm, terms: Sequence[Term], settings: StatedSettings | None = None
) -> ModelUncertainty:
    """Return the uncertainty of a model whose masses an arm's file states.

    Weight and inertia are of the same bodies, and are off together.
    """
    part = (settings or StatedSettings()).part
    bodies = part * base_directions(arm).reshape(len(arm.bodies), rigid_body.PER_LINK, -1)
    known = [term for term in terms if term.OF_LINKS]
    count, unknown = bodies.shape[-1], np.full(arm.n, np.nan)
    lower, upper = arm.range
    return ModelUncertainty(
        coefficients_of(known),
        {term.NAME: bodies[:, : term.OF_LINKS].reshape(-1, count) for term in known},
        np.zeros((arm.n, count)), np.zeros((3, count)), unknown, np.nan, unknown, lower, upper,
        unknown,
    )  # fmt: skip
