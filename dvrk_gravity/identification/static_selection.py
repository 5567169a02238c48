"""What each joint's torque is made of: chosen by the error on slabs of poses held out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arm import JOINT_NAMES, N_JOINTS
from dvrk_gravity.identification import result
from dvrk_gravity.identification.static_columns import N_BETA, Group, describe
from dvrk_gravity.identification.static_poses import blocks, inner_slabs
from dvrk_gravity.identification.static_solver import Choice, Table, solve_robust
from dvrk_gravity.recording.data import Array

# Prior size of the own function of order one, in robust standard deviations of the joint's torque
# without it; of the others, in those of what the joint's own position leaves.
OWN = (0.5, 1.0, 2.0, 4.0, 8.0)
OTHERS = (0.5, 1.5, 5.0)
# A group must lower the held-out squared error by so much, and by one standard error of the slabs'
# gains: one slab's luck is no reason.
LEAST_GAIN = 0.02
BETA_FREEDOM = 0.03  # N·m, about the beta of all joints, while one joint is looked at alone


@dataclass(frozen=True, eq=False)
class Moments:
    """Weighted products of one joint's columns and torque over some poses."""

    xx: Array
    xy: Array
    yy: float

    @classmethod
    def of(cls, x: Array, y: Array, weight: Array) -> Moments:
        """Sum over (N, p) columns, (N,) torques and (N,) weights."""
        weighted = x * weight[:, None]
        return cls(weighted.T @ x, weighted.T @ y, float(weight @ y**2))

    def without(self, other: Moments) -> Moments:
        """Return the sums over the remaining poses."""
        return Moments(self.xx - other.xx, self.xy - other.xy, self.yy - other.yy)

    def error(self, places: NDArray[np.int64], theta: Array) -> float:
        """Return the weighted sum of squared errors of some columns' coefficients."""
        xx, xy = self.xx[np.ix_(places, places)], self.xy[places]
        return float(theta @ xx @ theta - 2.0 * theta @ xy + self.yy)


@dataclass(frozen=True, eq=False)
class JointSearch:
    """One joint's columns, and the slabs that are held out.

    Attributes:
        table: All columns.
        joint: The joint.
        beta: (10,) of all joints, N·m, about which this joint's own may vary.
        train: Sums over what each held-out slab leaves.
        test: Sums over each slab.
        factor: (slabs,) how much each one counts.
        own: Robust standard deviation of the torque without the joint's own functions, N·m.
        rest: Of what these leave, N·m.
    """

    table: Table
    joint: int
    beta: Array
    train: tuple[Moments, ...]
    test: tuple[Moments, ...]
    factor: Array
    own: float
    rest: float

    def errors(self, choice: Choice) -> Array:
        """Return (slabs,) weighted sums of squared held-out errors."""
        columns = self.table.joints[self.joint]
        chosen = columns.of(choice.groups)
        places = np.concatenate([np.arange(N_BETA), N_BETA + chosen])
        mean = np.concatenate([self.beta, np.zeros(len(chosen))])
        prior = np.concatenate(
            [np.full(N_BETA, BETA_FREEDOM), columns.prior(choice.own, choice.others)[chosen]]
        )
        found = []
        for train, test in zip(self.train, self.test, strict=True):
            precision = train.xx[np.ix_(places, places)] + np.diag(prior**-2.0)
            theta = np.linalg.solve(precision, train.xy[places] + mean / prior**2)
            found.append(test.error(places, theta))
        return self.factor * np.array(found)

    def run(self, note: Callable[[result.Choice], None]) -> Choice:
        """Return the best choice; ``note`` is told every group that was tried."""
        own: Group = (self.joint,)
        choice = Choice((own,), self.own, 1.5 * self.rest)
        if self.joint not in self.table.poses.moving:
            return choice
        choice, errors = self._best([replace(choice, own=size * self.own) for size in OWN])
        waiting = [group for group in self.table.joints[self.joint].groups if group != own]
        while waiting:
            trials = [replace(choice, groups=(*choice.groups, group)) for group in waiting]
            found = [self.errors(trial) for trial in trials]
            best = int(np.argmin([one.sum() for one in found]))
            if not self._pays(errors, found[best]):
                for group, after in zip(waiting, found, strict=True):
                    note(self._choice(group, errors, after, False))
                break
            note(self._choice(waiting.pop(best), errors, found[best], True))
            choice, errors = trials[best], found[best]
        sizes = [(choice.own, others * self.rest) for others in OTHERS]
        sizes += [(size * self.own, choice.others) for size in OWN]
        return self._best([replace(choice, own=a, others=b) for a, b in sizes])[0]

    def _best(self, choices: Sequence[Choice]) -> tuple[Choice, Array]:
        found = [self.errors(choice) for choice in choices]
        best = int(np.argmin([one.sum() for one in found]))
        return choices[best], found[best]

    def _gain(self, before: Array, after: Array) -> tuple[float, float]:
        """Return the part of the squared error that goes, and its standard error over slabs."""
        gain = (before - after) / before.sum()
        return float(gain.sum()), float(gain.std(ddof=1) * np.sqrt(len(gain)))

    def _pays(self, before: Array, after: Array) -> bool:
        gain, uncertainty = self._gain(before, after)
        return gain > max(LEAST_GAIN, uncertainty)

    def _choice(self, group: Group, before: Array, after: Array, kept: bool) -> result.Choice:
        gain, uncertainty = self._gain(before, after)
        total = self.factor @ [test.yy for test in self.test]
        old, new = (float(np.sqrt(max(e.sum(), 0.0) / total)) for e in (before, after))
        return result.Choice(
            f"held_load {JOINT_NAMES[self.joint]}: function of {describe(group, JOINT_NAMES)}",
            kept,
            old,
            new,
            f"{'pays' if kept else 'does not pay'} on held-out slabs: {100 * gain:+.1f} ± "
            f"{100 * uncertainty:.1f} % of the squared error",
        )


def choose(
    table: Table, note: Callable[[result.Choice], None] = lambda choice: None
) -> tuple[Choice, ...]:
    """Choose what every joint's torque is made of.

    Args:
        table: Columns at the poses that may be seen.
        note: Told every group that was tried.
    """
    spread = np.maximum(table.poses.effort.std(axis=0), 1e-3)
    constants = [Choice(((j,),), 1e-6 * spread[j]) for j in range(N_JOINTS)]
    _, own, _ = solve_robust(table, constants)
    plain = [Choice(((j,),), 2.0 * own[j]) for j in range(N_JOINTS)]
    _, rest, _ = solve_robust(table, plain)
    rich = [Choice(table.joints[j].groups, 2.0 * own[j], 1.5 * rest[j]) for j in range(N_JOINTS)]
    solution, _, weight = solve_robust(table, rich)
    slabs_, blocks_ = inner_slabs(table.poses), blocks(table.poses)
    # Slabs alone ask for more smoothness than a fit needs that sees all of them; blocks, at
    # positions seen elsewhere, for less than one that meets others. Both count alike.
    share = sum(map(np.sum, slabs_)) / len(table.poses)
    masks = [*((mask, 1.0) for mask in slabs_), *((mask, max(share, 1.0)) for mask in blocks_)]
    chosen = []
    for joint in range(N_JOINTS):
        x = np.concatenate([table.gravity[:, joint], table.matrices[joint]], axis=1)
        y, w = table.poses.effort[:, joint], weight[:, joint]
        total = Moments.of(x, y, w)
        test = tuple(Moments.of(x[mask], y[mask], w[mask]) for mask, _ in masks)
        search = JointSearch(
            table, joint, solution.beta, tuple(total.without(one) for one in test), test,
            np.array([factor for _, factor in masks]), own[joint], rest[joint],
        )  # fmt: skip
        chosen.append(search.run(note))
    return tuple(chosen)
