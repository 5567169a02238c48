"""Which poses teach most about an arm at rest: chosen one by one, each stood at from both sides."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from dvrk_gravity.arms import Arm, rigid_body
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects import State, weight_directions
from dvrk_gravity.errors import PlanError
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.planning.design import MotionDesign, condition, prior_knowledge
from dvrk_gravity.planning.information import Knowledge
from dvrk_gravity.planning.keeping import slacks
from dvrk_gravity.planning.limits import PlanLimits
from dvrk_gravity.planning.plan import Plan
from dvrk_gravity.planning.pose_path import PosePath
from dvrk_gravity.planning.resting import resting_positions

Choice = Callable[[Array, int, Callable[[float], None]], list[int]]


@dataclass(frozen=True)
class PoseSettings:
    """How a static calibration is made.

    Attributes:
        candidates: Number of random poses among which those of the plan are chosen. Chosen.
        approach: Distance that every joint moves to a pose in the direction of approach, rad (a
            tenth of it, m): several times the displacement in which friction builds up, .01 to
            .03 rad.
        stand: Time at a pose from each side, s: the console's .5 s of settling, and a reading as
            long.
        reading: Part of that time in which efforts are read, s.
        part: Part of the greatest speeds and accelerations that moves use. Chosen.
        most: Greatest number of poses. Chosen.
        learnt: A parameter is reported if its standard error is below this part of what it was
            before. Chosen.
    """

    candidates: int = 800
    approach: float = 0.06
    stand: float = 1.0
    reading: float = 0.5
    part: float = 0.5
    most: int = 400
    learnt: float = 0.9


def design_poses(
    arm: Arm,
    limits: PlanLimits,
    duration: float,
    model: TorqueModel | None = None,
    seed: int = 1,
    settings: PoseSettings | None = None,
    report: Callable[[float], None] = lambda share: None,
) -> MotionDesign:
    """Return a plan of as many poses as a duration has time for.

    Each is the one that adds most to log det A beside those before it (Fedorov 1972, without the
    exchange). They are visited in the order of the nearest next one that keeps all limits on the
    way there; a pose that none leads to is left out.

    Args:
        arm: The arm.
        limits: What is kept, on the way, too.
        duration: Greatest, s.
        model: As for :func:`design_motion`.
        seed: Of the candidates.
        settings: See :class:`PoseSettings`.
        report: Called with the share that is done.

    Raises:
        PlanError: No position keeps the limits, or there is no time for two poses.
    """
    of = settings or PoseSettings()
    knowledge = prior_knowledge(arm, limits, model)

    def choose(candidates: Array, count: int, report: Callable[[float], None]) -> list[int]:
        return _choose_poses(knowledge, candidates, count, of.reading, report)

    motion = pose_path(arm, limits, duration, model, seed, of, choose, report)
    ordered = motion.poses
    weight = np.full(len(ordered), of.reading)
    up, down = (knowledge.gram(stands(ordered, direction), weight) for direction in (1.0, -1.0))
    parameters = zip(
        knowledge.names, knowledge.units, knowledge.before.tolist(),
        knowledge.errors(up + down).tolist(), strict=True,
    )  # fmt: skip
    # Of inertia, and of friction that grows with speed, poses say nothing.
    learnt = tuple(each for each in parameters if each[3] < of.learnt * each[2])
    weight_columns = rigid_body.weight_regressor(arm, ordered, arm.gravity) @ weight_directions(arm)
    return MotionDesign(
        Plan(arm, motion, limits), learnt, condition(weight_columns),
        tuple(slacks(motion, limits, arm, model)),
    )  # fmt: skip


def pose_path(
    arm: Arm,
    limits: PlanLimits,
    duration: float,
    model: TorqueModel | None,
    seed: int,
    of: PoseSettings,
    choose: Choice,
    report: Callable[[float], None],
) -> PosePath:
    """Return the way through poses that are chosen among random ones; see :func:`design_poses`.

    Args:
        arm: The arm.
        limits: What is kept.
        duration: Greatest, s.
        model: For efforts; ``None``: none are known.
        seed: Of the candidates.
        of: See :class:`PoseSettings`.
        choose: Returns the indices of so many of (N, n) poses, the best first.
        report: Called with the share that is done.

    Raises:
        PlanError: No position keeps the limits, or there is no time for two poses.
    """
    way = of.approach * arm.scale
    random = np.random.default_rng(seed)
    found = resting_positions(_narrow_limits(limits, way), arm, model, random, 10 * of.candidates)
    some = random.permutation(len(found))[: of.candidates]
    candidates = found[np.sort(some)]

    def path(poses: Array) -> PosePath:
        return PosePath(poses, way, of.stand, of.part, limits)

    count = min(of.most, len(candidates), int(duration / (2.0 * of.stand)))
    chosen = choose(candidates, count, lambda part: report(0.7 * part))
    ordered = _tour(candidates[chosen], path, limits, arm, model, duration,
                    lambda part: report(0.7 + 0.3 * part))  # fmt: skip
    if len(ordered) < 2:
        raise PlanError(f"{duration:g} s are too short for two poses: expected a longer --duration")
    return path(ordered)


def _narrow_limits(limits: PlanLimits, way: Array) -> PlanLimits:
    """Return limits within which a pose and both ends of its approaches are within limits."""
    combinations = []
    for row, each in zip(limits.rows[len(way) :], limits.combinations, strict=True):
        room = abs(float(row @ way))
        combinations.append(replace(each, lower=each.lower + room, upper=each.upper - room))
    return replace(
        limits, lower=limits.lower + way, upper=limits.upper - way,
        combinations=tuple(combinations),
    )  # fmt: skip


def stands(poses: Array, direction: float) -> State:
    """Return poses as they are read, at rest, reached from one side."""
    rest = np.zeros_like(poses)
    return State(poses, rest, rest, np.full(poses.shape, direction))


def _choose_poses(
    knowledge: Knowledge, poses: Array, count: int, reading: float, report: Callable[[float], None]
) -> list[int]:
    """Return the indices of poses, each the one that adds most to log det A."""
    scale = np.sqrt(reading / knowledge.noise)[:, None]
    both = [scale * knowledge.regressor(stands(poses, direction)) for direction in (1.0, -1.0)]
    x = np.concatenate(both, axis=1)  # (N, 2 n, p)
    covariance, found = np.eye(x.shape[-1]), list[int]()
    for number in range(count):
        # log det (A + X' X) - log det A = log det (1 + X A^-1 X')
        inner = np.eye(x.shape[1]) + x @ covariance @ x.transpose(0, 2, 1)
        gain = np.linalg.slogdet(inner)[1]
        gain[found] = -np.inf
        best = int(np.argmax(gain))
        found.append(best)
        gain = covariance @ x[best].T
        covariance = covariance - gain @ np.linalg.solve(inner[best], gain.T)
        report((number + 1) / count)
    return found


def _tour(
    poses: Array,
    path: Callable[[Array], PosePath],
    limits: PlanLimits,
    arm: Arm,
    model: TorqueModel | None,
    duration: float,
    report: Callable[[float], None],
) -> Array:
    """Return poses in an order, as many as there is time for; the first ones matter most."""
    # Limits of joints and their combinations hold between any two poses; others must be checked.
    checked = bool(limits.boxes) or model is not None
    wanted = len(poses)
    while True:
        ordered = _nearest(poses[:wanted], path, limits, arm, model, checked)
        lasts = path(ordered).duration
        report(duration / max(duration, lasts))
        if lasts <= duration or wanted <= 1:
            return ordered if lasts <= duration else ordered[:0]
        wanted = min(wanted - 1, int(wanted * duration / lasts) + 1)


def _nearest(
    poses: Array, path: Callable[[Array], PosePath], limits: PlanLimits, arm: Arm,
    model: TorqueModel | None, checked: bool,
) -> Array:  # fmt: skip
    """Return poses, after each the nearest one to which the way keeps all limits."""

    def keeps(some: Array) -> bool:
        return not checked or all(
            each.left >= 0.0 for each in slacks(path(some), limits, arm, model)
        )

    left = list(range(len(poses)))
    order = [left.pop(next((k for k in left if keeps(poses[[k]])), 0))]
    while left:
        ways = np.abs((poses[left] - poses[order[-1]]) @ limits.rows.T)
        lasts = (ways / limits.rates[0]).max(axis=1)
        for k in np.argsort(lasts, kind="stable").tolist():
            if keeps(poses[[order[-1], left[k]]]):
                order.append(left.pop(k))
                break
        else:
            break
    return poses[order]
