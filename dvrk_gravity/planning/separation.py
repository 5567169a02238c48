"""From what a diagnosis could not separate to a plan, and to what the plan is expected to show."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.effects import State
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.planning.design import series_basis
from dvrk_gravity.planning.fourier import FourierMotion
from dvrk_gravity.planning.information import ModelKnowledge
from dvrk_gravity.planning.keeping import Slack, slacks
from dvrk_gravity.planning.optimal import MotionSearch, SolverSettings
from dvrk_gravity.planning.plan import Plan
from dvrk_gravity.planning.plan_limits import PlanLimits
from dvrk_gravity.planning.pose_path import PosePath
from dvrk_gravity.planning.poses import PoseSettings, pose_path, stands
from dvrk_gravity.planning.resting import resting_positions
from dvrk_gravity.planning.rivalry import STRONG, Rivalry, Separation
from dvrk_gravity.units import pose, quantity


@dataclass(frozen=True)
class SeparationSettings:
    """Of a search for what separates rivals.

    Attributes:
        duration: Of the motion, or of all poses at most, s. Chosen: as long as a diagnosis needs to
            judge a cause, and short enough to record in between.
        solver: Effort of the search for a motion. Chosen: a third of a plan's, of which fewer
            columns are to be separated. The penalty is softer: the value is a logarithm.
        candidates: Random poses among which are chosen. Chosen.
        states: Random states at which torques are compared. Chosen.
    """

    duration: float = 40.0
    solver: SolverSettings = field(
        default_factory=lambda: SolverSettings(
            draws=60, starts=3, first=15, rounds=4, iterations=25, stiffness=3.0, seconds=60.0
        )
    )
    candidates: int = 200
    states: int = 500


@dataclass(frozen=True, eq=False)
class Unseparated:
    """What a diagnosis could not separate.

    Attributes:
        model: The model that was diagnosed.
        rivalries: Pairs of explanations; at least one.
        noise: (n,) variance of the mean torque of a second, (N·m)^2 s.
        coherent: (n,) standard deviation of an error that looks like a cause in all of a motion,
            N·m: no duration averages it out.
        poses: Static poses were diagnosed.
    """

    model: TorqueModel
    rivalries: tuple[Rivalry, ...]
    noise: Array
    coherent: Array
    poses: bool = False

    def objective(self, duration: float) -> Separation:
        """Return what a motion of a duration, s, is expected to separate."""
        known = self.model.uncertainty
        uncertain = ModelKnowledge(self.model, known) if known is not None and known.size else None
        noise = self.noise + self.coherent**2 * duration
        return Separation(self.model.arm, self.rivalries, noise, uncertain)


@dataclass(frozen=True)
class Expected:
    """What a plan is expected to show of a rivalry.

    Attributes:
        words: The two in words.
        again: Log Bayes factor that the diagnosed motion is expected to give if it is recorded
            again; ``None``: not known.
        planned: The lesser of those that are expected of the plan, if either is true.
        why: Why the plan does not separate them; ``""`` if it does.
    """

    words: str
    again: float | None
    planned: float
    why: str = ""

    @property
    def separates(self) -> bool:
        """Whether the evidence is expected to be strong."""
        return self.planned >= STRONG


@dataclass(frozen=True, eq=False)
class SeparationDesign:
    """A plan that separates rivals, and what it promises.

    Attributes:
        plan: The plan.
        expected: Of each rivalry.
        slacks: What it leaves of each limit.
    """

    plan: Plan
    expected: tuple[Expected, ...]
    slacks: tuple[Slack, ...]

    @property
    def separates(self) -> bool:
        """Whether it is expected to separate any of them."""
        return any(each.separates for each in self.expected)


def design_separation(
    unseparated: Unseparated,
    limits: PlanLimits,
    duration: float | None = None,
    poses: bool = False,
    seed: int = 1,
    settings: SeparationSettings | None = None,
    report: Callable[[float], None] = lambda share: None,
) -> SeparationDesign:
    """Return the motion, or the poses, expected to separate best what a diagnosis could not.

    Args:
        unseparated: What that is; :func:`dvrk_gravity.diagnosis.load_unseparated` reads it.
        limits: What the plan keeps, with the model's efforts.
        duration: s; of poses the greatest. ``None``: that of the settings.
        poses: Static poses from both sides, instead of a motion.
        seed: Of the starts.
        settings: Of the search.
        report: Called with the share of the search that is done.

    Raises:
        PlanError: No motion keeps the limits.
    """
    of = settings or SeparationSettings()
    lasts = of.duration if duration is None else duration
    model, objective = unseparated.model, unseparated.objective(lasts)
    motion: FourierMotion | PosePath
    if poses:
        motion, gram = _poses(objective, limits, model, lasts, seed, of, report)
    else:
        search = MotionSearch(series_basis(lasts), limits, objective, model, seed, of.solver)
        motion = search.best(report)
        gram = search.gram(motion)
    expected = tuple(
        Expected(rivalry.words, rivalry.again, value,
                 "" if value >= STRONG else _why(unseparated, rivalry, limits, poses, seed, of))
        for rivalry, value in zip(unseparated.rivalries, objective.expected(gram), strict=True)
    )  # fmt: skip
    return SeparationDesign(
        Plan(model.arm, motion, limits), expected, tuple(slacks(motion, limits, model.arm, model))
    )


def _poses(
    objective: Separation, limits: PlanLimits, model: TorqueModel, duration: float, seed: int,
    of: SeparationSettings, report: Callable[[float], None],
) -> tuple[PosePath, Array]:  # fmt: skip
    """Return poses that are chosen one by one, each the one that adds most, and their G."""
    settings = replace(PoseSettings(), candidates=of.candidates)

    def grams(poses: Array) -> Array:
        """Return (N, p, p) G of each pose from both sides."""
        scale = np.sqrt(settings.reading / objective.noise)[:, None]
        both = [scale * objective.regressor(stands(poses, sense)) for sense in (1.0, -1.0)]
        x = np.concatenate(both, axis=1)
        return np.asarray(x.transpose(0, 2, 1) @ x)

    def choose(poses: Array, count: int, report: Callable[[float], None]) -> list[int]:
        each, found = grams(poses), list[int]()
        total = np.zeros(each.shape[1:])
        for number in range(count):
            left = [k for k in range(len(poses)) if k not in found]
            values = [objective.score(total + each[k])[0] for k in left]
            found.append(left[int(np.argmax(values))])
            total = total + each[found[-1]]
            report((number + 1) / count)
        return found

    path = pose_path(model.arm, limits, duration, model, seed, settings, choose, report)
    return path, grams(path.poses).sum(axis=0)


def _why(
    unseparated: Unseparated, rivalry: Rivalry, limits: PlanLimits, poses: bool, seed: int,
    of: SeparationSettings,
) -> str:  # fmt: skip
    """Return where both differ most within the limits, and by how much more than the noise."""
    model, random = unseparated.model, np.random.default_rng(seed)
    arm = model.arm
    q = resting_positions(limits, arm, model, random, of.states)
    rest = np.zeros_like(q)
    if poses:
        state = stands(q, 1.0)
    else:
        state = State(q, random.uniform(-1.0, 1.0, q.shape) * limits.velocity, rest)
    time = np.zeros(len(q))
    torques = [
        rival.columns(state, time) @ rival.theta for rival in (rivalry.first, rivalry.second)
    ]
    apart = np.abs(torques[0] - torques[1])
    error = np.sqrt(unseparated.coherent**2 + unseparated.noise / of.duration)
    where, joint = np.unravel_index(int(np.argmax(apart / error)), apart.shape)
    unit = arm.joints[joint].effort_unit
    most = f"at most by {quantity(float(apart[where, joint]), unit)} on {arm.joint_names[joint]}"
    least = quantity(float(error[joint]), unit)
    if apart[where, joint] < 2.0 * error[joint]:
        return (
            f"they are the same torque within the limits: they differ {most}, of which errors of "
            f"{least} are expected"
        )
    return (
        f"they differ {most}, at {pose(q[where], arm.units)}: too seldom, or too much like what "
        f"the model is uncertain of, for errors of {least}"
    )
