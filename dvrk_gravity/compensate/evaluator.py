"""Terms prepared for one sample at a time: the same torque as theirs, in a fifth of the time.

Of a payload it is the weight alone: a compensator leaves inertia to the hand.

A term's own ``torque`` takes any number of samples. For one sample, at 1 kHz, nearly all of its
time goes into the calls of numpy and not into arithmetic; here whatever does not depend on the
sample is worked out beforehand, and what is left is put into as few calls as possible.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import reduce, singledispatch

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from dvrk_gravity.arms.mtm import beta_tree
from dvrk_gravity.arms.tree import Tree
from dvrk_gravity.terms import (
    CoulombFriction,
    DirectionalCable,
    ElasticCable,
    Gravity,
    Payload,
    State,
    Term,
    ViscousFriction,
)
from dvrk_gravity.terms.polynomial import Range

Array = NDArray[np.float64]
Evaluator = Callable[[Array, "Array | None"], Array]
"""Torque (n,) from positions (n,) and velocities (n,), ``None`` where these are unknown."""
Parts = Callable[[Array, "Array | None", "Array | None"], tuple[Array, Array]]
"""Torque without friction and friction, (n,) each, from positions, velocities, and the velocities
at which friction is taken."""


def prepare_parts(terms: Iterable[Term], part: Array) -> Parts:
    """Return the evaluator of a sum of terms that keeps friction apart.

    Args:
        terms: The terms, friction whole.
        part: (n,) part of friction to take, at each joint and motor.
    """
    terms = list(terms)
    cables = [term for term in terms if isinstance(term, DirectionalCable)]
    others = [term for term in terms if not isinstance(term, DirectionalCable)]
    conservative = prepare_sum(term for term in others if not term.FRICTION)
    # Scaled where it lives: parts of a motor's friction that differ by joint would put more
    # power into the arm than the friction takes out.
    friction = prepare_sum(term.scaled(part) for term in others if term.FRICTION)
    if not cables:
        return lambda q, qd, moving: (conservative(q, qd), friction(q, moving))
    (cable,) = cables
    both = _cable_parts(cable.elastic(), cable.scaled(part))
    if friction is _zeros:

        def without(q: Array, qd: Array | None, moving: Array | None) -> tuple[Array, Array]:
            elastic, rubbing = both(q, moving)
            return conservative(q, qd) + elastic, rubbing

        return without

    def evaluate(q: Array, qd: Array | None, moving: Array | None) -> tuple[Array, Array]:
        elastic, rubbing = both(q, moving)
        return conservative(q, qd) + elastic, friction(q, moving) + rubbing

    return evaluate


def prepare_sum(terms: Iterable[Term]) -> Evaluator:
    """Return the evaluator of a sum of terms; of none, it returns zeros."""
    evaluators = [prepare(term) for term in terms]
    return reduce(_add, evaluators) if evaluators else _zeros


def _add(first: Evaluator, second: Evaluator) -> Evaluator:
    return lambda q, qd: first(q, qd) + second(q, qd)


@singledispatch
def prepare(term: Term) -> Evaluator:
    """Return the evaluator of a term; a term without one of its own here goes the general way."""
    return lambda q, qd: term.torque(State(q, qd))


@prepare.register
def _(term: Gravity) -> Evaluator:
    return _weight(beta_tree(term.arm, term.beta, term.vector)) if term.enabled else _zeros


@prepare.register
def _(term: Payload) -> Evaluator:
    return _weight(term.weight) if term.weighs else _zeros


def _weight(tree: Tree) -> Evaluator:
    model, data, expand = tree.model, tree.data, tree.expand

    def evaluate(q: Array, qd: Array | None) -> Array:
        return pin.computeGeneralizedGravity(model, data, expand.dot(q)).dot(expand)

    return evaluate


@prepare.register
def _(term: ElasticCable) -> Evaluator:
    coefficients, powers = term.coefficients, _powers(term.valid, len(term.coefficients))
    sum_up = np.ones(len(coefficients)).dot
    return lambda q, qd: sum_up(coefficients * powers(q))


@prepare.register
def _(term: DirectionalCable) -> Evaluator:
    both, sum_up = _cable_parts(term.elastic(), term.scaled(term.ratio)), np.ones(2).dot
    return lambda q, qd: sum_up(both(q, qd))


def _cable_parts(elastic: ElasticCable, friction: DirectionalCable) -> Evaluator:
    """Return the evaluator of a directional cable's two parts, (2, n): they share their powers."""
    if friction.shape != "linear":
        return lambda q, qd: np.stack([elastic.torque(State(q)), friction.torque(State(q, qd))])
    count = len(elastic.coefficients)
    slope = friction.ratio / (friction.saturation_velocity - friction.dead_band)
    both = np.vstack([elastic.coefficients, friction.positive * slope])
    # A velocity cut at the one less the same velocity cut at the other: the blend's ramp.
    edges = np.array([friction.saturation_velocity, friction.dead_band])
    lowest, full_less_dead = -edges, np.array([1.0, -1.0]).dot
    powers, sum_up = _powers(elastic.valid, count), np.repeat(np.eye(2), count, axis=1).dot
    factors = np.zeros((2 * count, len(friction.ratio)))
    plain, blended = factors[:count], factors[count:]

    def evaluate(q: Array, qd: Array | None) -> Array:
        powers(q, plain)
        ramp = 0.0 if qd is None else full_less_dead(np.minimum(np.maximum(qd, lowest), edges))
        np.multiply(plain, ramp, blended)
        return sum_up(both * factors)

    return evaluate


@prepare.register
def _(term: CoulombFriction) -> Evaluator:
    # Joints and motors side by side, motion upwards and downwards one above the other.
    to_motor = term.arm.joint_to_actuator
    n = len(to_motor)
    motion = np.vstack([np.eye(n), to_motor])
    slope = np.tile(1.0 / np.maximum(term.transition_velocity, 1e-9), 2)
    lower = np.repeat([[0.0], [-1.0]], 2 * n, axis=1)
    levels = (term.joint_positive, term.motor_positive, term.joint_negative, term.motor_negative)
    spread = np.diag(np.concatenate(levels)) @ np.vstack([motion, motion])

    def evaluate(q: Array, qd: Array | None) -> Array:
        if qd is None:
            return np.zeros(n)
        part = np.minimum(np.maximum(motion.dot(qd) * slope, lower), lower + 1.0)
        return part.ravel().dot(spread)

    return evaluate


@prepare.register
def _(term: ViscousFriction) -> Evaluator:
    unit = np.eye(len(term.joint))
    damping = term.torque(State(unit, unit))  # linear: row j is what joint j's unit speed makes
    return lambda q, qd: np.zeros(len(q)) if qd is None else qd.dot(damping)


def _zeros(q: Array, qd: Array | None) -> Array:
    return np.zeros(len(q))


def _powers(valid: Range, count: int) -> Callable[..., Array]:
    """Return what makes (count, n) powers 0, 1, … of positions held within a range."""
    lower, upper = valid.lower, valid.upper
    steps = np.ones((count, len(lower)))

    def powers(q: Array, out: Array | None = None) -> Array:
        steps[1:] = np.minimum(np.maximum(q, lower), upper)
        return np.multiply.accumulate(steps, 0, None, out)

    return powers
