"""What all that weighs has in common: gravity's parameters, and quick weights of one pose."""

from __future__ import annotations

import pinocchio as pin

from dvrk_gravity.arms import GRAVITY, Tree
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects.base.term import Evaluator
from dvrk_gravity.parameters import Parameter


def weight_evaluator(tree: Tree) -> Evaluator:
    """Return the evaluator of the torques that hold a tree up."""
    model, data, expand = tree.model, tree.data, tree.expand

    def evaluate(q: Array, qd: Array | None) -> Array:
        return pin.computeGeneralizedGravity(model, data, expand.dot(q)).dot(expand)

    return evaluate


def gravity_parameters() -> tuple[Parameter, ...]:
    """Declare the gravity flag and the direction of gravity."""
    return (
        Parameter("gravity_enabled", True, "", "gravity flag: false leaves the gravity term out"),
        Parameter(
            "gravity_vector", (0.0, 0.0, -GRAVITY), "m/s^2", "gravity in the arm's base frame",
            lower=-30.0, upper=30.0, lengths=(3,),
        ),
    )  # fmt: skip
