"""From an arm, what is known of it, and its limits to a plan, and to what the plan promises."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dvrk_gravity.arms import Arm, rigid_body
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects import base_directions
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.planning.coverage_objective import CoverageObjective
from dvrk_gravity.planning.fourier import Basis, FourierMotion
from dvrk_gravity.planning.information import Knowledge, ModelKnowledge, PriorKnowledge
from dvrk_gravity.planning.keeping import Slack, slacks
from dvrk_gravity.planning.limits import PlanLimits
from dvrk_gravity.planning.optimal import MotionSearch, SolverSettings
from dvrk_gravity.planning.plan import Plan
from dvrk_gravity.tabular import Columns, Tabular


@dataclass(frozen=True)
class SeriesSettings:
    """Frequencies and ramps of a motion.

    Attributes:
        highest: Highest frequency, Hz: that of published exciting motions of these arms.
        most: Greatest number of frequencies. They are multiples of half a cycle in a motion, in
            ratios as equal as these allow. Chosen: more are slower to solve, and reach no more.
        cycles: Cycles of the lowest frequency in a motion. Chosen: slow enough to go through the
            range.
        lowest: Least frequency, Hz, also of a long motion. Chosen: joints then pass their range at
            a tenth of their speed.
        ramp: Time from rest into the motion, and out of it, s; as `excite`'s.
        most_ramp: Greatest part of a short motion that a ramp may take. Chosen.
    """

    highest: float = 0.6
    most: int = 14
    cycles: float = 1.5
    lowest: float = 0.02
    ramp: float = 3.0
    most_ramp: float = 0.2


@dataclass(frozen=True, eq=False)
class MotionDesign(Tabular):
    """A plan and what it promises.

    Attributes:
        plan: The plan.
        parameters: Name, unit, standard deviation before the motion, and standard error expected
            after it, of each parameter.
        condition: Condition number of the base parameters' columns, each divided by its range; of
            poses, of those that weigh.
        slacks: What it leaves of each limit.
    """

    plan: Plan
    parameters: tuple[tuple[str, str, float, float], ...]
    condition: float
    slacks: tuple[Slack, ...]

    def _headline(self) -> str:
        return f"{self.plan.arm.name}: {self.plan.duration:.4g} s"

    def _columns(self) -> Columns:
        """Return the standard error of each parameter, now and as expected of the motion."""
        columns = ("parameter", "unit", "now", "expected")
        rows = zip(*self.parameters, strict=True) if self.parameters else ((),) * len(columns)
        return {name: list(values) for name, values in zip(columns, rows, strict=True)}


def series_basis(duration: float, settings: SeriesSettings | None = None) -> Basis:
    """Return window and waves of a motion of a duration, s."""
    of = settings or SeriesSettings()
    step = 0.5 / duration
    lowest = max(of.cycles / duration, of.lowest)
    wanted = np.geomspace(lowest, max(of.highest, 2.0 * lowest), of.most)
    frequency = step * np.unique(np.round(wanted / step))
    return Basis(frequency, min(of.ramp, of.most_ramp * duration), duration)


def design_motion(
    arm: Arm,
    limits: PlanLimits,
    basis: Basis,
    model: TorqueModel | None = None,
    seed: int = 1,
    settings: SolverSettings | None = None,
    report: Callable[[float], None] = lambda share: None,
) -> MotionDesign:
    """Return the most informative motion that was found within limits.

    Args:
        arm: The arm.
        limits: What the motion keeps.
        basis: What it is made of; see :func:`series_basis`.
        model: A model of it, whose posterior is the prior, if it has one; efforts are kept by it.
        seed: Of the starts.
        settings: Effort of the search.
        report: Called with the share of the search that is done.

    Raises:
        PlanError: No motion keeps the limits.
    """
    knowledge = prior_knowledge(arm, limits, model)
    wanted = CoverageObjective(knowledge, limits.lower, limits.upper)
    search = MotionSearch(basis, limits, wanted, model, seed, settings)
    motion = search.best(report)
    gram = search.gram(motion)
    errors = knowledge.errors(gram)
    parameters = zip(
        knowledge.names, knowledge.units, knowledge.before.tolist(), errors.tolist(), strict=True
    )
    return MotionDesign(
        Plan(arm, motion, limits), tuple(parameters), condition_number(arm, motion),
        tuple(slacks(motion, limits, arm, model)),
    )  # fmt: skip


def prior_knowledge(arm: Arm, limits: PlanLimits, model: TorqueModel | None) -> Knowledge:
    """Return the knowledge before a motion: a model's posterior, else the effects' priors."""
    if model is not None and model.uncertainty is not None and model.uncertainty.size:
        return ModelKnowledge(model, model.uncertainty)
    return PriorKnowledge(arm, limits.lower, limits.upper)


def condition_number(arm: Arm, motion: FourierMotion, rate: float = 50.0) -> float:
    """Return the condition number of the regressor of the base parameters over a motion.

    They are the orthogonal combinations that identification fits. Each column is divided by its
    range (greatest less least value), as published motions of these arms are judged.

    Args:
        arm: The arm.
        motion: The motion.
        rate: Samples per second.
    """
    time = np.arange(int(motion.duration * rate)) / rate
    full = rigid_body.regressor(arm, *motion.at(time), arm.gravity).reshape(
        -1, rigid_body.PER_LINK * len(arm.bodies)
    )
    return condition(full @ base_directions(arm))


def condition(columns: Array) -> float:
    """Return the condition number of (…, p) columns, each divided by its range."""
    columns = columns.reshape(-1, columns.shape[-1])
    spread = np.ptp(columns, axis=0)
    return float(np.linalg.cond(columns / spread)) if spread.all() else float("inf")
