"""Which columns each joint's torque has at static poses: chosen by error on held-out slabs."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.estimation import (
    STANDARD_ERRORS,
    Folds,
    FoldSums,
    Scored,
    ScoredTrial,
    combined_folds,
    fit_folds,
    inner_slabs,
    masks,
    relative_gain,
    select,
    sequential,
)
from dvrk_gravity.identification.poses.solver import (
    Composition,
    Group,
    Table,
    solve_robust,
)
from dvrk_gravity.identification.result import Choice, improvement

# Candidate prior sizes: of the joint's own function of order one, in robust standard
# deviations of its torque without it; of the other functions, in those of what its own position
# leaves. A grid, a factor of two to three apart.
OWN = (0.5, 1.0, 2.0, 4.0, 8.0)
OTHERS = (0.5, 1.5, 5.0)
LEAST_GAIN = 0.02  # part of the held-out squared error that a group must remove. Chosen
# Of gravity's coefficients (``solver.GRAVITY_SD``) about those of all joints, while one joint is
# fitted alone. Chosen.
GRAVITY_FREEDOM = 0.03
BLOCKS = 15  # of consecutive poses, held out beside the slabs. Chosen


GroupTrial = ScoredTrial[Group, Composition]


@dataclass(frozen=True, eq=False)
class JointSearch:
    """One joint's columns, and the slabs that are held out.

    Attributes:
        table: All columns.
        joint: The joint.
        gravity: (k,) coefficients of all joints, about which this joint's own may vary.
        sums: Of this joint's columns and torque, over slabs.
        factor: (slabs,) how much each one counts.
        own: Robust standard deviation of the torque without the joint's own functions, N·m or N.
        rest: The same with them.
        choices: Every group that was tested.
    """

    table: Table
    joint: int
    gravity: Array
    sums: FoldSums
    factor: Array
    own: float
    rest: float
    choices: list[Choice] = field(default_factory=list)

    def composed(self, composition: Composition) -> Scored[Composition]:
        """Return a composition with its (slabs, 1) held-out errors."""
        columns = self.table.joints[self.joint]
        chosen, count = columns.of(composition.groups), len(self.gravity)
        index = np.concatenate([np.arange(count), count + chosen])
        mean = np.concatenate([self.gravity, np.zeros(len(chosen))])
        prior = columns.prior(composition.own, composition.others)[chosen]
        scale = np.concatenate([np.full(count, GRAVITY_FREEDOM), prior])
        theta = fit_folds(*self._seen, index, scale, mean)
        return Scored(composition, self.factor[:, None] * self.sums.held_out.error(theta))

    @cached_property
    def _seen(self) -> tuple[Array, Array]:
        return combined_folds(self.sums.train, np.ones(1))

    def run(self) -> Composition:
        """Return the best composition."""
        group: Group = (self.joint,)
        made = Composition((group,), self.own, 1.5 * self.rest)
        if self.joint not in self.table.poses.moving:
            return made
        sizes = [size * self.own for size in OWN]
        start = self._best([replace(made, own=size) for size in sizes])
        groups = len(self.table.joints[self.joint].groups)
        found, vain = select(self, start, groups)
        self.choices.extend(self._choice(trial, found, False) for trial in vain)
        made = found.choice
        tuned = [replace(made, others=others * self.rest) for others in OTHERS]
        return self._best([*tuned, *(replace(made, own=size) for size in sizes)]).choice

    def moves(self, state: Scored[Composition]) -> Iterable[Group]:
        """Yield the groups that are not in yet."""
        groups = self.table.joints[self.joint].groups
        return [group for group in groups if group not in state.choice.groups]

    def attempt(self, state: Scored[Composition], moves: Sequence[Group]) -> list[GroupTrial]:
        """Return what each group would bring."""
        made = state.choice
        trials: list[GroupTrial] = []
        for group in moves:
            after = self.composed(replace(made, groups=(*made.groups, group)))
            gain, deviation = relative_gain(state.errors, after.errors)
            passes = gain > max(LEAST_GAIN, STANDARD_ERRORS * deviation)
            trials.append(ScoredTrial(group, gain, passes, after, gain, deviation))
        return trials

    def choose(self, trials: Sequence[GroupTrial]) -> GroupTrial | None:
        """Return the best group, if it passes."""
        best = max(trials, key=lambda trial: trial.worth, default=None)
        return best if best is not None and best.passes else None

    def take(self, state: Scored[Composition], trial: GroupTrial) -> Scored[Composition]:
        """Return the composition with a group, and note it."""
        self.choices.append(self._choice(trial, state, True))
        return trial.after

    def _best(self, compositions: Sequence[Composition]) -> Scored[Composition]:
        return min(map(self.composed, compositions), key=lambda made: float(made.errors.sum()))

    def _choice(self, trial: GroupTrial, before: Scored[Composition], kept: bool) -> Choice:
        names = self.table.arm.joint_names
        total = self.factor @ [test.power[0] for test in self.sums.test]
        old, new = (
            float(np.sqrt(max(made.errors.sum(), 0.0) / total)) for made in (before, trial.after)
        )
        of = " x ".join(names[joint] for joint in trial.move)
        return Choice(
            f"held_load {names[self.joint]}: function of {of}",
            kept,
            old,
            new,
            improvement("error on held-out slabs", trial.gain, trial.deviation, kept),
        )


def choose(table: Table) -> tuple[list[Composition], list[Choice]]:
    """Choose the columns of every joint's torque; also return every group that was tested.

    Args:
        table: Columns at the poses that may be seen.
    """
    joints = range(table.arm.n)
    poses = table.poses
    spread = np.maximum(poses.effort.std(axis=0), 1e-3)
    _, own, _ = solve_robust(table, [Composition(((j,),), 1e-6 * spread[j]) for j in joints])
    _, rest, _ = solve_robust(table, [Composition(((j,),), 2.0 * own[j]) for j in joints])
    rich = [Composition(table.joints[j].groups, 2.0 * own[j], 1.5 * rest[j]) for j in joints]
    solution, _, weight = solve_robust(table, rich)
    of_slabs = inner_slabs(poses.q, poses.moving)
    of_order = masks(sequential(len(poses), min(BLOCKS, len(poses))))
    # Slabs alone ask for more smoothness than a fit to all of them needs; blocks, at positions
    # seen elsewhere, for less than new positions need. Both count equally.
    share = sum(map(np.sum, of_slabs)) / len(poses)
    factor = np.array([1.0] * len(of_slabs) + [max(share, 1.0)] * len(of_order))
    tested = np.array([*of_slabs, *of_order])
    folds = Folds(tested, tested)
    chosen, choices = list[Composition](), list[Choice]()
    for joint in joints:
        x = np.concatenate([table.gravity[:, joint], table.matrices[joint]], axis=1)[:, None]
        sums = FoldSums(x, poses.effort[:, [joint]], folds, weight[:, [joint]])
        search = JointSearch(
            table, joint, solution.gravity, sums, factor, float(own[joint]), float(rest[joint])
        )
        chosen.append(search.run())
        choices += search.choices
    return chosen, choices
