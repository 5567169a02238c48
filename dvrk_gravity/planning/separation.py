"""From what a diagnosis could not separate to a plan, and to what the plan is expected to show."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from time import process_time

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.effects import State
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.planning.design import series_basis
from dvrk_gravity.planning.fourier import FourierMotion
from dvrk_gravity.planning.information import ModelKnowledge
from dvrk_gravity.planning.keeping import Slack, slacks
from dvrk_gravity.planning.limits import PlanLimits
from dvrk_gravity.planning.optimal import MotionSearch, SolverSettings
from dvrk_gravity.planning.pairs import HypothesisPair, MotionFactory, Separation
from dvrk_gravity.planning.plan import Plan
from dvrk_gravity.planning.pose_path import PosePath
from dvrk_gravity.planning.poses import PoseSettings, pose_path, stands
from dvrk_gravity.planning.resting import resting_positions
from dvrk_gravity.units import pose, quantity

_STATES = 500  # of a motion, at which torques are compared in words
_ANYWHERE = 600  # states of any motion: ten times the parameters of a model and two causes
# Poses whose score is computed, those of the largest gain by its slope: with 74 pairs of causes one
# takes 0.3 s. Chosen.
_LIKELY = 5
_LONGEST = 600.0  # s, as long a motion as `plan` makes
_NARROW = 0.05  # of a joint's limits: it was hardly moved at identification. Chosen
_SURE = 0.95  # probability from which a plan counts as one that separates. A convention


@dataclass(frozen=True)
class SeparationSettings:
    """Of a search for what separates causes.

    Attributes:
        duration: Of the motion, or of all poses at most, s. Chosen: as long as a diagnosis needs to
            judge a cause, and short enough to record in between.
        solver: Effort of the search for a motion. Chosen: a fifth of a plan's, for most of what
            separates is found early. The penalty is softer: the value is a logarithm.
        candidates: Random poses among which are chosen, for ``solver.seconds`` at most. Chosen.
    """

    duration: float = 40.0
    solver: SolverSettings = field(
        default_factory=lambda: SolverSettings(
            draws=60, starts=2, first=15, rounds=4, iterations=20, stiffness=3.0, seconds=60.0
        )
    )
    candidates: int = 200


@dataclass(frozen=True, eq=False)
class UnresolvedPairs:
    """What a diagnosis could not separate.

    Attributes:
        model: The model that was diagnosed.
        pairs: Pairs of explanations; at least one.
        motion_of: What they see of states.
        noise: (n,) variance of the mean torque of a second, (N·m)^2 s.
        coherent: (n,) standard deviation of an error that looks like a cause in all of a motion,
            N·m: no duration averages it out.
        poses: Static poses were diagnosed.
        lasted: How long what was diagnosed lasts, s.
    """

    model: TorqueModel
    pairs: tuple[HypothesisPair, ...]
    motion_of: MotionFactory
    noise: Array
    coherent: Array
    poses: bool = False
    lasted: float = 0.0

    def objective(self, duration: float) -> Separation:
        """Return what a motion of a duration, s, is expected to separate.

        Diagnosed together with the first recordings: an error that looks like a cause in all of
        them counts as much more as they are longer together.
        """
        known = self.model.uncertainty
        uncertain = ModelKnowledge(self.model, known) if known is not None and known.size else None
        first, both = (
            self.noise + self.coherent**2 * lasts for lasts in (self.lasted, self.lasted + duration)
        )
        kept, scattered = (float(np.max(part / both)) for part in (first, self.noise))
        return Separation(
            self.model.arm, self.pairs, self.motion_of, both, uncertain,
            kept=kept, scattered=scattered,
        )  # fmt: skip

    def hidden(self, limits: PlanLimits) -> list[tuple[bool, bool]]:
        """Return of each pair whether no motion is expected to show the first, or the second.

        Within limits, where the model was identified, in ten minutes. See
        :meth:`Separation.hidden`.

        Raises:
            PlanError: Limits that no position keeps.
        """
        arm, random = self.model.arm, np.random.default_rng(0)
        q = resting_positions(_identified_limits(limits, self.model), arm, None, random, _ANYWHERE)
        rates = random.uniform(-1.0, 1.0, (2, *q.shape))
        state = State(q, rates[0] * limits.velocity, rates[1] * limits.acceleration)
        return self.objective(_LONGEST).hidden(state, _LONGEST)


@dataclass(frozen=True)
class ExpectedEvidence:
    """What a plan is expected to show of a pair.

    Attributes:
        names: The two in words.
        planned: Evidence of the diagnosed recordings and the plan, as a log-likelihood: the lesser
            of those that are expected if either is true.
        chance: Probability that it will be clear, likewise.
        why: Why the plan does not separate them; ``""`` if it does.
    """

    names: tuple[str, str]
    planned: float
    chance: float
    why: str = ""

    @property
    def words(self) -> str:
        """Both in words."""
        return " or ".join(self.names)

    @property
    def separates(self) -> bool:
        """Whether that is all but certain."""
        return self.chance >= _SURE


@dataclass(frozen=True, eq=False)
class SeparationDesign:
    """A plan that separates causes, and what it promises.

    Attributes:
        plan: The plan.
        expected: Of each pair.
        slacks: What it leaves of each limit.
    """

    plan: Plan
    expected: tuple[ExpectedEvidence, ...]
    slacks: tuple[Slack, ...]

    @property
    def separates(self) -> bool:
        """Whether it is expected to separate any of them."""
        return any(each.separates for each in self.expected)


def design_separation(
    unresolved: UnresolvedPairs,
    limits: PlanLimits,
    duration: float | None = None,
    poses: bool = False,
    seed: int = 1,
    settings: SeparationSettings | None = None,
    report: Callable[[float], None] = lambda share: None,
) -> SeparationDesign:
    """Return the motion, or the poses, expected to separate best what a diagnosis could not.

    Args:
        unresolved: What that is; :func:`load_unresolved` reads it.
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
    model, objective = unresolved.model, unresolved.objective(lasts)
    within = _identified_limits(limits, model)
    motion: FourierMotion | PosePath
    if poses:
        motion, gram = _poses(objective, within, model, lasts, seed, of, report)
    else:
        search = MotionSearch(series_basis(lasts), within, objective, model, seed, of.solver)
        motion = search.best(report)
        gram = search.gram(motion)
    found = zip(unresolved.pairs, objective.expected(gram), unresolved.hidden(limits), strict=True)
    expected = tuple(
        ExpectedEvidence(
            pair.names, value, chance,
            "" if chance >= _SURE
            else nothing_shows(pair, hidden) or _why(unresolved, pair, motion),
        )
        for pair, (value, chance), hidden in found
    )  # fmt: skip
    return SeparationDesign(
        Plan(model.arm, motion, limits), expected, tuple(slacks(motion, limits, model.arm, model))
    )


def _identified_limits(limits: PlanLimits, model: TorqueModel) -> PlanLimits:
    """Return limits within which the model was identified: beyond, any torque may be its own.

    Faster, too: what it lacks of inertia shows then. A joint that was hardly moved then, or never
    within its limits, keeps them.
    """
    known = model.uncertainty
    if known is None:
        return limits
    lower, upper = np.maximum(limits.lower, known.lower), np.minimum(limits.upper, known.upper)
    enough = upper - lower > _NARROW * (limits.upper - limits.lower)
    return replace(
        limits,
        lower=np.where(enough, lower, limits.lower), upper=np.where(enough, upper, limits.upper),
        velocity=np.where(enough, np.fmin(limits.velocity, known.speed), limits.velocity),
    )  # fmt: skip


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
        begun = process_time()
        each, found = grams(poses), list[int]()
        total = np.zeros(each.shape[1:])
        slope = objective.score(total)[1]
        for number in range(count):
            gain = np.einsum("ij,kij->k", slope, each)
            gain[found] = -np.inf
            likely = np.argsort(-gain, kind="stable")[: min(_LIKELY, len(poses) - number)]
            values = [objective.score(total + each[k]) for k in likely]
            best = max(range(len(likely)), key=lambda k: values[k][0])
            found.append(int(likely[best]))
            total, slope = total + each[found[-1]], values[best][1]
            used = (process_time() - begun) / of.solver.seconds
            report(max((number + 1) / count, min(used, 1.0)))
            if used > 1.0 and len(found) > 1:  # the first ones separate most
                break
        return found

    path = pose_path(model.arm, limits, duration, model, seed, settings, choose, report)
    return path, grams(path.poses).sum(axis=0)


def nothing_shows(pair: HypothesisPair, hidden: tuple[bool, bool]) -> str:
    """Return what no motion within limits is expected to separate; ``""`` if one may separate all.

    Args:
        pair: Two causes.
        hidden: Whether none is expected to show the first if it is true, and the second.
    """
    if all(none or not wanted for none, wanted in zip(hidden, pair.required, strict=True)):
        return (
            "they are the same torque within the limits, to about the errors: no motion of this "
            "arm there is expected to separate them"
        )
    for none, cause, other in zip(
        hidden, (pair.first, pair.second), (pair.second, pair.first), strict=True
    ):
        if none:
            return (
                f"no motion of this arm within its limits is expected to rule out {other.words}, "
                f"if it is {cause.words}"
            )
    return ""


def _why(
    unresolved: UnresolvedPairs, pair: HypothesisPair, motion: FourierMotion | PosePath
) -> str:
    """Return where both differ most in the best that was found, and what errors are expected."""
    arm = unresolved.model.arm
    if isinstance(motion, PosePath):
        time, state = np.zeros(len(motion.poses)), stands(motion.poses, 1.0)
    else:
        time = np.linspace(0.0, motion.duration, _STATES)
        state = State(*motion.at(time))
    passed = unresolved.motion_of(state, time)
    first, second = (cause.columns(passed) @ cause.theta for cause in (pair.first, pair.second))
    apart = np.abs(first - second)
    error = np.sqrt(unresolved.coherent**2 + unresolved.noise / motion.duration)
    where, joint = np.unravel_index(int(np.argmax(apart / error)), apart.shape)
    unit, most = arm.joints[joint].effort_unit, float(apart[where, joint])
    least = quantity(float(error[joint]), unit)
    differ = f"they differ by at most {quantity(most, unit)} on {arm.joint_names[joint]}"
    return (
        f"{differ}, at {pose(state.q[where], arm.units)}: too little beside errors of {least} and "
        "what the model and their own sizes are uncertain by"
    )
