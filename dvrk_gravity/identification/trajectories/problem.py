"""The least-squares problem of motions: build it, solve it, choose its columns, reweigh it."""

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
from dvrk_gravity.identification.trajectories.selection import LEAST_GAIN, ColumnSelection, FoldSums
from dvrk_gravity.model import Columns
from dvrk_gravity.observation import Design, Observation, build_design

# Choices of what depends on the other terms' torque, which change with it. Chosen: a third changes
# nothing on the arms of `make peers`.
_ROUNDS = 3
# Part of a motor's torque that a model leaves, at first. Chosen: the iteration forgets it.
_FIRST_GUESS = 0.1


@dataclass(frozen=True, eq=False)
class Weighting:
    """Weights of motors and samples, from the residual of a model.

    Attributes:
        certainty: (m,) inverse variance of one sample, over the number of samples that count as
            one.
        power: (m,) mean square of the torque, (N·m)^2.
        sample: (N, m) robust weights.
    """

    certainty: Array
    power: Array
    sample: Array

    @cached_property
    def motor(self) -> Array:
        """(m,) weights of motors in a fit.

        Halfway (geometric mean) between a motor's own certainty and equal weights of all relative
        errors: a correlated residual, of a model that adapts to it, gives only a rough variance.
        """
        relative, counts = self.power * self.certainty, self.sample.any(axis=0)
        typical = np.exp(np.mean(np.log(relative[counts])))
        return np.where(counts, np.sqrt(relative * typical) / self.power, 0.0)


@dataclass(frozen=True, eq=False)
class Problem:
    """A least-squares problem, before its columns are chosen.

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


def build_problem(
    motions: Sequence[Observation],
    arm: Arm,
    effects: Sequence[str] | None = None,
    progress: Callable[[float], None] = lambda share: None,
    form: type[Columns] = Columns,
    least_gain: float = LEAST_GAIN,
) -> Problem:
    """Return the least-squares problem of some motions.

    Args:
        motions: At least one.
        arm: The arm.
        effects: Effects that may be used besides the rigid body; ``None``: all.
        progress: Called with the share of the regressor that is done.
        form: Which columns there are.
        least_gain: See :class:`ColumnSelection`.
    """
    q = np.concatenate([motion.q for motion in motions])
    columns = form(arm, q.min(axis=0), q.max(axis=0))
    return problem_of(build_design(columns, motions, progress), motions, effects, least_gain)


def problem_of(
    design: Design, motions: Sequence[Observation], effects: Sequence[str] | None,
    least_gain: float,
) -> Problem:  # fmt: skip
    """Return the problem of the regressor of some motions; see :func:`build_problem`."""
    clock = [motion.clock[0] for motion in motions]
    folds = make_folds(design.time, design.part, design.state.q, design.rate, clock=clock)
    weighting = _weigh(design)
    whole = NormalEquations.of(design.x, design.y, weighting.sample)
    sums = FoldSums(design, folds, weighting.sample, whole)
    selection = ColumnSelection(design.columns, sums, weighting.motor, effects, least_gain)
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
    """Return the problem, weighted again, and the columns that improve the held-out error.

    The richest model, whose residual weighs motors at first, overfits the noise of some more than
    that of others. So the search goes on with the weights of its own residual (feasible
    generalised least squares).

    Args:
        problem: The problem, weighted by its richest model.
        begin: Columns to start with; at least one set.
        progress: Called with the share that is done, a guess.
    """
    chosen = problem.selection.search(begin, progress)
    kept = [choice for choice in problem.selection.choices if choice.kept]
    problem = with_motor_weights(problem, chosen)
    problem.selection.choices = kept
    chosen = problem.selection.run(chosen)
    return with_motor_weights(problem, chosen), chosen


def with_loads(
    problem: Problem, chosen: list[int], motions: Sequence[Observation]
) -> tuple[Problem, list[int]]:
    """Return the problem with the columns that depend on the torque of a fit, and the choice.

    Args:
        problem: The problem.
        chosen: Columns of the fit.
        motions: Of the problem.
    """
    for _ in range(_ROUNDS):
        before = chosen
        problem, chosen = _with_loads(problem, chosen, motions)
        if chosen == before:
            break
    return problem, chosen


def _with_loads(
    problem: Problem, chosen: list[int], motions: Sequence[Observation]
) -> tuple[Problem, list[int]]:
    """Return the problem with these columns beside the fit as it is, and the choice then."""
    design, weighting, selection = problem.design, problem.weighting, problem.selection
    columns = design.columns
    theta = np.zeros(len(columns.columns))
    theta[chosen] = solved(problem, chosen).theta
    columns = columns.with_terms(columns.terms(theta))
    new = columns.load_dependent
    if not any(selection.allowed(columns.columns[index].effect) for index in new):
        return problem, chosen
    x = design.x.copy()
    x[..., new] = build_design(columns, motions, chosen=new).x
    design = replace(design, columns=columns, x=x)
    equations = NormalEquations.of(x, design.y, weighting.sample)
    sums = FoldSums(design, problem.folds, weighting.sample, equations)
    selection = replace(selection, columns=columns, sums=sums)
    problem = replace(problem, design=design, equations=equations, selection=selection)
    found = selection.of_others(chosen)
    return problem, chosen if found == chosen else selection.run(found)


def with_motor_weights(problem: Problem, chosen: Sequence[int]) -> Problem:
    """Return the problem with motors weighted by the residual of the chosen columns."""
    design, weighting, selection = problem.design, problem.weighting, problem.selection
    predicted = design.x[:, :, list(chosen)] @ solved(problem, chosen).theta
    weighting = _weighting(design, weighting.sample * (design.y - predicted), weighting.sample)
    return replace(problem, weighting=weighting, selection=selection.with_weights(weighting.motor))


def _weigh(design: Design) -> Weighting:
    """Return noise, its correlation, and outliers, by the richest model.

    With every column in, the residual is noise and not a missing term, so that no structure is
    taken for outliers.
    """
    columns, seen = design.columns, design.compared
    spread = np.maximum(_FIRST_GUESS * design.y.std(axis=0, where=seen), 1e-6)

    def fitted(state: RobustState[Array]) -> tuple[Array, Array]:
        motor = spread**-2.0
        if state.residual is not None:
            # An outlier must not determine its motor's noise.
            motor = _weighting(design, state.weight * state.residual, state.weight).motor
        equations = NormalEquations.of(design.x, design.y, state.weight)
        theta = fit(equations, motor, columns.scale, columns.positive).theta
        return theta, design.y - design.x @ theta

    start: RobustState[Array] = RobustState(design.informative.astype(float), spread)
    found = reweighted(fitted, start, RobustSettings(), used=design.fitted)
    assert found.residual is not None
    return _weighting(design, found.weight * found.residual, found.weight)


def _weighting(design: Design, residual: Array, sample: Array) -> Weighting:
    """Return the weighting by (N, m) residuals, beside (N, m) robust weights."""
    seen = design.compared
    longest = int(LONGEST_CORRELATION * design.rate)
    correlated = correlation_time(residual, design.part, longest)
    variance = np.maximum(residual.var(axis=0, where=seen), 1e-12)
    power = np.maximum(np.mean(design.y**2, axis=0, where=seen), 1e-12)
    return Weighting(1.0 / (variance * correlated), power, sample)
