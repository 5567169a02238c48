"""The least-squares problem of motions: build it, fit and score columns, weigh it again."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects import RigidColumns
from dvrk_gravity.estimation import (
    LONGEST_CORRELATION,
    FoldSums,
    HeldOutSums,
    NormalEquations,
    RobustSettings,
    RobustState,
    SignedFits,
    Solution,
    combined_folds,
    correlation_time,
    fit,
    make_folds,
    reweighted,
)
from dvrk_gravity.identification.result import Choice
from dvrk_gravity.model import Columns
from dvrk_gravity.observation import Design, Observation, build_design

Correction = Callable[[Solution], Array]

# Part of the squared held-out error, in the mean over motors, that each further column must remove.
# Chosen.
LEAST_GAIN = 0.004
# Part of a motor's RMS speed below which it turns round. No term has exactly what friction does
# there, and in a motion of few frequencies a spring may imitate it. Chosen: from .05 to .2 the same
# columns are chosen on every arm of `make peers`.
SLOW = 0.1
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
    """A least-squares problem whose columns are chosen by the error on held-out blocks.

    Attributes:
        design: The samples.
        sums: Of their products, and what is held out.
        weighting: Of motors and samples.
        effects: Effects that may be used besides the rigid body; ``None``: all.
        least_gain: Part of the squared held-out error, in the mean over motors, that each further
            column must remove.
        choices: The last trial of every effect and joint.
    """

    design: Design
    sums: FoldSums
    weighting: Weighting
    effects: Sequence[str] | None
    least_gain: float
    choices: tuple[Choice, ...] = ()

    def allowed(self, effect: str) -> bool:
        """Whether an effect may be used."""
        return self.effects is None or effect in RigidColumns.EFFECTS or effect in self.effects

    def fit(self, chosen: Sequence[int]) -> Solution:
        """Return the fit of the chosen columns to all samples."""
        return self._fitted(self.sums.whole.select(chosen), chosen)

    def unseen(
        self, chosen: Sequence[int], corrected: Correction = lambda found: found.theta
    ) -> Array:
        """Return (N, m) torques, each predicted by the fit that had not seen it.

        Args:
            chosen: Columns of the fits.
            corrected: From the fit to the coefficients that predict.
        """
        return self.sums.predicted(lambda seen: corrected(self._fitted(seen, chosen)), chosen)

    def score(self, chosen: Sequence[int]) -> Array:
        """Return (folds, m) held-out sums of squared errors."""
        return self.sums.held_out.error(self.fold_fits.fit(chosen))

    @cached_property
    def fold_fits(self) -> SignedFits:
        """Fits to all folds but one."""
        columns = self.design.columns
        seen = combined_folds(self.sums.train, self.weighting.motor)
        return SignedFits(*seen, columns.scale, columns.positive)

    @cached_property
    def held_out_moving(self) -> HeldOutSums:
        """Errors on each fold, without the samples at which a motor turns round."""
        design, speed = self.design, self.design.state.qd
        assert speed is not None
        speed = np.abs(design.columns.arm.actuator_position(speed))
        slow = design.informative & (speed < SLOW * np.sqrt(np.mean(speed**2, axis=0)))
        still = slow.any(axis=1)
        turning = self.sums.of(self.sums.folds.tested & still, slow.astype(float))
        return HeldOutSums(
            [whole - part for whole, part in zip(self.sums.test, turning, strict=True)]
        )

    def _fitted(self, equations: NormalEquations, chosen: Sequence[int]) -> Solution:
        columns, index = self.design.columns, list(chosen)
        return fit(equations, self.weighting.motor, columns.scale[index], columns.positive[index])


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
        least_gain: See :class:`Problem`.
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
    # Held-out errors count every informative sample in full.
    counted = design.informative.astype(float)
    sums = FoldSums(design.x, design.y, folds, weighting.sample, counted)
    return Problem(design, sums, weighting, effects, least_gain)


def with_motor_weights(problem: Problem, chosen: Sequence[int]) -> Problem:
    """Return the problem with motors weighted by the residual of the chosen columns."""
    design, sample = problem.design, problem.weighting.sample
    predicted = design.x[:, :, list(chosen)] @ problem.fit(chosen).theta
    return replace(problem, weighting=_weighting(design, sample * (design.y - predicted), sample))


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
