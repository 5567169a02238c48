"""Terms prepared for one sample at a time: the same torque as theirs, in a fifth of the time.

A term's own ``torque`` takes any number of samples. For one sample, at 1 kHz, nearly all of its
time goes into the calls of numpy and not into arithmetic; a term's ``prepare`` works out beforehand
whatever does not depend on the sample, and puts what is left into as few calls as possible. Here
they are added up, friction apart.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import reduce

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.effects import Evaluator, Term

Parts = Callable[[Array, "Array | None", "Array | None"], tuple[Array, Array]]
"""Torque without friction and friction, (n,) each, from positions, velocities, and the velocities
at which friction is taken."""


def prepare_parts(terms: Iterable[Term], part: Array) -> Parts:
    """Return the evaluator of a sum of terms that keeps friction apart.

    Args:
        terms: The terms, friction whole.
        part: (n,) part of friction to take, at each joint and motor.
    """
    # Friction is scaled where it lives: parts of a motor's friction that differ by joint would put
    # more power into the arm than the friction takes out.
    fused: list[Evaluator] = []
    smooth: list[Evaluator] = []
    rubbing: list[Evaluator] = []
    for term in terms:
        together = term.prepare_parts(part)
        if together is not None:
            fused.append(together)
            continue
        for found, kind in zip(term.split(part), (smooth, rubbing), strict=True):
            if found is not None:
                kind.append(found.prepare())
    conservative, friction = _sum(smooth), _sum(rubbing)
    if not fused:
        return lambda q, qd, moving: (conservative(q, qd), friction(q, moving))
    both = _sum(fused)
    if not rubbing:

        def without(q: Array, qd: Array | None, moving: Array | None) -> tuple[Array, Array]:
            elastic, alone = both(q, moving)
            return conservative(q, qd) + elastic, alone

        return without

    def evaluate(q: Array, qd: Array | None, moving: Array | None) -> tuple[Array, Array]:
        elastic, more = both(q, moving)
        return conservative(q, qd) + elastic, friction(q, moving) + more

    return evaluate


def prepare_sum(terms: Iterable[Term]) -> Evaluator:
    """Return the evaluator of a sum of terms; of none, it returns zeros."""
    return _sum([term.prepare() for term in terms])


def _sum(evaluators: list[Evaluator]) -> Evaluator:
    return reduce(_add, evaluators) if evaluators else _zeros


def _add(first: Evaluator, second: Evaluator) -> Evaluator:
    return lambda q, qd: first(q, qd) + second(q, qd)


def _zeros(q: Array, qd: Array | None) -> Array:
    return np.zeros(q.shape)
