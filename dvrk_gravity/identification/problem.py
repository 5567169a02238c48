"""The least-squares problem that motions pose, before any term is chosen."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from dvrk_gravity.arm import Arm
from dvrk_gravity.identification.columns import Columns
from dvrk_gravity.identification.folds import Folds, make_folds
from dvrk_gravity.identification.moments import Design, Moments, build_design
from dvrk_gravity.identification.motion import Motion
from dvrk_gravity.identification.posture import Posture
from dvrk_gravity.identification.regression import (
    ROUNDS,
    Solution,
    correlation_time,
    huber_weights,
    solve,
)
from dvrk_gravity.identification.selection import Selection, split_moments
from dvrk_gravity.recording.data import Array

MEMORY = 2.0  # s, longest correlation of the residual that is looked at


@dataclass(frozen=True, eq=False)
class Weighting:
    """What the residual of a model says about the noise, and what a fit makes of it.

    Attributes:
        certainty: (7,) inverse variance of one sample, divided by how many samples count as one.
        power: (7,) mean square of the torque, (N·m)^2.
        sample: (n, 7) robust weights.
    """

    certainty: Array
    power: Array
    sample: Array

    @cached_property
    def motor(self) -> Array:
        """(7,) weights of motors in a fit.

        Halfway (geometric mean) between a motor's own certainty and weights by which every
        motor's error relative to its torque counts alike: a correlated residual, of a model that
        bends to it, tells a variance only roughly.
        """
        relative = self.power * self.certainty
        alike = np.exp(np.mean(np.log(relative)))
        return np.asarray(np.sqrt(relative * alike) / self.power)


@dataclass(frozen=True, eq=False)
class Problem:
    """What is asked of the data, before any term is chosen.

    Attributes:
        design: The samples.
        folds: What is held out.
        weighting: Of motors and samples.
        moments: Of all samples, by their robust weights.
        selection: The search for terms.
    """

    design: Design
    folds: Folds
    weighting: Weighting
    moments: Moments
    selection: Selection


def pose(
    motions: Sequence[Motion],
    arm: Arm,
    effects: Sequence[str] | None = None,
    progress: Callable[[float], None] = lambda share: None,
    posture: Posture | None = None,
    form: type[Columns] = Columns,
) -> Problem:
    """Return the least-squares problem of some motions, before any term is chosen.

    Args:
        motions: At least one.
        arm: The arm.
        effects: Effects that may be used besides the rigid body; ``None``: all.
        progress: Called with the share of the regressor that is done.
        posture: Where joints and base are; with links, its slopes are columns too.
        form: Which columns there are.
    """
    q = np.concatenate([motion.state.q for motion in motions])
    columns = form(arm, q.min(axis=0), q.max(axis=0), posture)
    design = build_design(columns, motions, progress)
    folds = make_folds(design)
    weighting = weigh(design)
    whole, train, test = split_moments(design, folds, weighting.sample)
    selection = Selection(columns, train, test, weighting.motor, effects=effects)
    return Problem(design, folds, weighting, whole, selection)


def solved(problem: Problem, chosen: Sequence[int]) -> Solution:
    """Return the fit of the chosen columns to all samples."""
    columns, index = problem.design.columns, list(chosen)
    return solve(
        problem.moments.select(index), problem.weighting.motor, columns.scale[index],
        columns.positive[index],
    )  # fmt: skip


def choose(
    problem: Problem, begin: Sequence[list[int]], progress: Callable[[float], None]
) -> tuple[Problem, list[int]]:
    """Return the columns that pay, and the problem weighed by what they leave.

    The richest model, whose residual weighs motors at first, bends itself to the noise of some
    more than to that of others. So the choice goes on with the weights that its own residual
    gives (feasible generalised least squares).

    Args:
        problem: The problem, weighed by its richest model.
        begin: Columns to start with; at least one.
        progress: Called with the share that is done, a guess.
    """
    chosen = problem.selection.search(begin, progress)
    kept = [choice for choice in problem.selection.choices if choice.kept]
    problem = reweighed(problem, chosen)
    problem.selection.choices = kept
    chosen = problem.selection.run(chosen, lambda share: None)
    return reweighed(problem, chosen), chosen


def reweighed(problem: Problem, chosen: Sequence[int]) -> Problem:
    """Return the problem with motors weighed by what a fit of the chosen columns leaves."""
    design, weighting, selection = problem.design, problem.weighting, problem.selection
    predicted = design.x[:, :, list(chosen)] @ solved(problem, chosen).theta
    weighting = _weighting(design, weighting.sample * (design.y - predicted), weighting.sample)
    return replace(problem, weighting=weighting, selection=selection.weighed(weighting.motor))


def weigh(design: Design) -> Weighting:
    """Estimate each motor's noise, its correlation, and outliers, from the richest model.

    With every column in, what remains is noise and not a missing term, so that no structure is
    taken for outliers.
    """
    columns = design.columns
    sample = np.ones_like(design.y)
    seen = design.measured
    motor = 1.0 / np.maximum(0.1 * design.y.std(axis=0, where=seen), 1e-6) ** 2
    for _ in range(ROUNDS):
        moments = Moments.of(design.x, design.y, sample)
        theta = solve(moments, motor, columns.scale, columns.positive).theta
        residual = design.y - design.x @ theta
        for j, rows in enumerate(seen.T):
            sample[rows, j] = huber_weights(residual[rows, j])
        # An outlier must not tell how noisy its motor is.
        weighting = _weighting(design, sample * residual, sample)
        motor = weighting.motor
    return weighting


def _weighting(design: Design, residual: Array, sample: Array) -> Weighting:
    """Return what (n, 7) residuals say, beside (n, 7) robust weights."""
    seen = design.measured
    together = correlation_time(residual, design.part, int(MEMORY * design.rate))
    variance = np.maximum(residual.var(axis=0, where=seen), 1e-12)
    power = np.maximum(np.mean(design.y**2, axis=0, where=seen), 1e-12)
    return Weighting(1.0 / (variance * together), power, sample)
