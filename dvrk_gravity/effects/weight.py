"""The weight of a tree of bodies at one pose, as quickly as Pinocchio has it."""

from __future__ import annotations

import pinocchio as pin

from dvrk_gravity.effects.term import Array, Evaluator
from dvrk_gravity.tree import Tree


def weight_evaluator(tree: Tree) -> Evaluator:
    """Return the evaluator of the torques that hold a tree up."""
    model, data, expand = tree.model, tree.data, tree.expand

    def evaluate(q: Array, qd: Array | None) -> Array:
        return pin.computeGeneralizedGravity(model, data, expand.dot(q)).dot(expand)

    return evaluate
