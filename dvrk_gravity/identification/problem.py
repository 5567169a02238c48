"""The least-squares problem that motions pose, before any term is chosen."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.estimation import (
    LONGEST_CORRELATION,
    Folds,
    NormalEquations,
    RobustSettings,
    RobustState,
    Solution,
    correlation_time,
    fit,
    make_folds,
    reweighted,
)
from dvrk_gravity.identification.columns import Columns
from dvrk_gravity.identification.design import Design, build_design
from dvrk_gravity.identification.kinematic_calibration import KinematicCalibration
from dvrk_gravity.identification.motion import CalibrationMotion
from dvrk_gravity.identification.selection import ColumnSelection, split_equations


@dataclass(frozen=True)
class WeightSettings:
    """Where the iteration of weights begins.

    Attributes:
        first_guess: Part of a motor's torque that a model leaves. Chosen: the iteration forgets
            it.
    """

    first_guess: float = 0.1


@dataclass(frozen=True, eq=False)
class Weighting:
    """What the residual of a model says about the noise, and what a fit makes of it.

    Attributes:
        certainty: (m,) inverse variance of one sample, divided by how many samples count as one.
        power: (m,) mean square of the torque, (N·m)^2.
        sample: (n, m) robust weights.
    """

    certainty: Array
    power: Array
    sample: Array

    @cached_property
    def motor(self) -> Array:
        """(m,) weights of motors in a fit.

        Halfway (geometric mean) between a motor's own certainty and weights by which every
        motor's error relative to its torque counts alike: a correlated residual, of a model that
        bends to it, tells a variance only roughly.
        """
        relative, counts = self.power * self.certainty, self.sample.any(axis=0)
        typical = np.exp(np.mean(np.log(relative[counts])))
        return np.where(counts, np.sqrt(relative * typical) / self.power, 0.0)


@dataclass(frozen=True, eq=False)
class Problem:
    """What is asked of the data, before any term is chosen.

    Attributes:
        design: The samples.
        folds: What is held out.
        weighting: Of motors and samples.
        equations: Of all samples, by their robust weights.
        selection: The search for terms.
    """

    design: Design
    folds: Folds
    weighting: Weighting
    equations: NormalEquations
    selection: ColumnSelection


def pose(
    motions: Sequence[CalibrationMotion],
    arm: Arm,
    effects: Sequence[str] | None = None,
    progress: Callable[[float], None] = lambda share: None,
    kinematics: KinematicCalibration | None = None,
    form: type[Columns] = Columns,
) -> Problem:
    """Return the least-squares problem of some motions, before any term is chosen.

    Args:
        motions: At least one.
        arm: The arm.
        effects: Effects that may be used besides the rigid body; ``None``: all.
        progress: Called with the share of the regressor that is done.
        kinematics: Where joints and base are; with links, its slopes are columns too.
        form: Which columns there are.
    """
    q = np.concatenate([motion.state.q for motion in motions])
    columns = form(arm, q.min(axis=0), q.max(axis=0), kinematics)
    design = build_design(columns, motions, progress)
    clock = [motion.source for motion in motions]
    folds = make_folds(design.time, design.part, design.state.q, design.rate, clock=clock)
    weighting = weigh(design)
    whole, train, test = split_equations(design, folds, weighting.sample)
    selection = ColumnSelection(columns, train, test, weighting.motor, effects=effects)
    return Problem(design, folds, weighting, whole, selection)


def solved(problem: Problem, chosen: Sequence[int]) -> Solution:
    """Return the fit of the chosen columns to all samples."""
    columns, index = problem.design.columns, list(chosen)
    return fit(
        problem.equations.select(index), problem.weighting.motor, columns.scale[index],
        columns.positive[index],
    )  # fmt: skip


def choose(
    problem: Problem, begin: Sequence[list[int]], progress: Callable[[float], None]
) -> tuple[Problem, list[int]]:
    """Return the columns that improve the held-out error, and the problem weighed by the rest.

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
    columns, seen = design.columns, design.compared
    spread = np.maximum(WeightSettings().first_guess * design.y.std(axis=0, where=seen), 1e-6)

    def fitted(state: RobustState[Array]) -> tuple[Array, Array]:
        motor = spread**-2.0
        if state.residual is not None:
            # An outlier must not tell how noisy its motor is.
            motor = _weighting(design, state.weight * state.residual, state.weight).motor
        equations = NormalEquations.of(design.x, design.y, state.weight)
        theta = fit(equations, motor, columns.scale, columns.positive).theta
        return theta, design.y - design.x @ theta

    start: RobustState[Array] = RobustState(design.told.astype(float), spread)
    found = reweighted(fitted, start, RobustSettings(), used=design.fitted)
    assert found.residual is not None
    return _weighting(design, found.weight * found.residual, found.weight)


def _weighting(design: Design, residual: Array, sample: Array) -> Weighting:
    """Return what (n, m) residuals say, beside (n, m) robust weights."""
    seen = design.compared
    together = correlation_time(residual, design.part, int(LONGEST_CORRELATION * design.rate))
    variance = np.maximum(residual.var(axis=0, where=seen), 1e-12)
    power = np.maximum(np.mean(design.y**2, axis=0, where=seen), 1e-12)
    return Weighting(1.0 / (variance * together), power, sample)
