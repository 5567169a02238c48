"""Springs that span several joints: a cable bundle, a belt, a gas spring between two links."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects.base.arrays import (
    Values,
    as_array,
    as_value,
    joint_array,
    position_offset,
    read_rows,
    write_rows,
)
from dvrk_gravity.effects.base.effect import Hypothesis, spread
from dvrk_gravity.effects.base.joint_dynamics import JointDynamics
from dvrk_gravity.effects.base.linear_term import LinearTerm
from dvrk_gravity.effects.base.meaning import MORE, Meaning, meanings, size
from dvrk_gravity.effects.base.motion import Motion, State
from dvrk_gravity.effects.base.site import Site
from dvrk_gravity.effects.base.term import Evaluator
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.parameters import Parameter, Value

# Joints between the ends of a spring, 1 for neighbours. Derived: a spring is fastened to two
# links, and one over a single joint is an `elastic_cable`. It spans a joint and the next, or three
# joints, of which a cable guided along the middle one's axis leaves the outer two. Longer ones
# would be more comparisons (of seven joints 21 pairs for 11) for what arms do not have.
_REACH = (1, 2)
# Of a spring's torque in the middle of a motion, by which it grows up to its end at least. Chosen:
# with less it is a constant at two joints, as two offsets are.
_GROWS = 0.25
_SAME = 1e-9  # of the greatest stiffness, by which rounding lets two that are one differ


def pairs(arm: Arm) -> list[tuple[int, int]]:
    """Return the pairs of joints that a spring may span, the one nearer to the base first."""
    return [(i, i + away) for i in range(arm.n) for away in _REACH if i + away < arm.n]


@dataclass(frozen=True, eq=False)
class JointSpring(LinearTerm):
    """tau = K q + c with a symmetric K: the gradient of V(q) = q' K q / 2 + c' q.

    One spring of stiffness k that is stretched by a q_i + b q_j - s has the potential
    k (a q_i + b q_j - s)^2 / 2, hence K_ii = k a^2, K_jj = k b^2, K_ij = K_ji = k a b,
    c_i = -k a s and c_j = -k b s. Several springs add up.

    Trajectories are not fitted with it. A fit that looked for K_ij of all pairs put some into four
    of ten arms without such springs (MuJoCo's mtml and ur5, seeds 7100 to 7109).

    Attributes:
        arm: The arm.
        stiffness: (n, n) symmetric, N·m/rad.
        constant: (n,) torque where all positions are zero, N·m.
    """

    NAME = "joint_spring"
    AT_POSES = True
    NOT_FITTED = "`diagnose` finds it and extends the model"
    REMEDY = "look at the springs, belts and cables that run along {joint} to a joint beyond it"
    MEANINGS = meanings(
        stiffness=size("N·m/rad", MORE),
        ratio=Meaning(label="its stretch by the second joint, by that of the first", least=0.0),
        torque=Meaning("N·m", None, ("up", "down"), "torque in the middle of the motion"),
    )

    arm: Arm
    stiffness: Array
    constant: Array

    @classmethod
    def schema(cls, arm: Arm) -> tuple[Parameter, ...]:
        rows = (
            Parameter(
                f"{cls.NAME}.{joint.name}", (), "N·m/rad",
                f"torque of springs between joints by the position of each, at {joint.name}",
                lengths=(arm.n,),
                units=tuple(
                    f"{joint.own_unit('N·m')}/{other.own_unit('rad')}" for other in arm.joints
                ),
            )
            for joint in arm.joints
        )  # fmt: skip
        meaning = "torque of springs between joints where all positions are zero"
        return (*rows, joint_array(arm, f"{cls.NAME}.constant", "N·m", meaning))

    @classmethod
    def from_parameters(cls, arm: Arm, values: Mapping[str, Value]) -> JointSpring | None:
        """The stiffness must be symmetric."""
        stiffness = read_rows(arm, values, cls.NAME, arm.n, "a number for each joint").T
        constant = as_array(values.get(f"{cls.NAME}.constant"), arm.n, 0.0)
        differ = np.abs(stiffness - stiffness.T) > _SAME * np.abs(stiffness).max(initial=0.0)
        if differ.any():
            i, j = np.argwhere(differ)[0].tolist()
            raise ConfigError(
                f"{cls.NAME}.{arm.joint_names[i]}[{j}]", stiffness[i, j],
                f"{stiffness[j, i]:g}, as {cls.NAME}.{arm.joint_names[j]}[{i}]: a spring pulls at "
                "both of its joints",
            )  # fmt: skip
        return cls(arm, stiffness, constant) if stiffness.any() or constant.any() else None

    def parameters(self) -> dict[str, Value]:
        rows = write_rows(self.arm, self.NAME, self.stiffness.T)
        return rows | {f"{self.NAME}.constant": as_value(self.constant)}

    def torque(self, state: State) -> Array:
        return state.q @ self.stiffness + self.constant

    def prepare(self) -> Evaluator:
        by_position, constant = self.stiffness.dot, self.constant
        return lambda q, qd: by_position(q) + constant

    def joint_dynamics(self, arm: Arm, q: Array) -> JointDynamics:
        return JointDynamics(arm, constant=self.constant, coupling=self.stiffness)

    @property
    def theta(self) -> Array:
        """(n (n + 3) / 2,) K's upper triangle row by row, then the constants."""
        return np.concatenate([self.stiffness[np.triu_indices(self.arm.n)], self.constant])

    def with_theta(self, theta: Array) -> JointSpring:
        n = self.arm.n
        upper = np.zeros((n, n))
        upper[np.triu_indices(n)] = theta[:-n]
        stiffness = upper + upper.T - np.diag(np.diag(upper))
        return replace(self, stiffness=stiffness, constant=np.asarray(theta[-n:]))

    def regressor(self, state: State) -> Array:
        rows, columns = np.triu_indices(self.arm.n)
        k = np.arange(len(rows))
        result = np.zeros((*state.q.shape, len(k) + self.arm.n))
        result[..., rows, k] = state.q[..., columns]
        result[..., columns, k] = state.q[..., rows]
        result[..., len(k) :] = np.eye(self.arm.n)
        return result

    @classmethod
    def hypotheses(cls, motion: Motion) -> Iterator[Hypothesis]:
        """For each pair of joints that move, stretched by their sum or their difference."""
        arm, (middle, half) = motion.arm, motion.travel
        for i, j in pairs(arm):
            if not (motion.moves[i] and motion.moves[j]):
                continue
            for form, sign in (("sum", 1.0), ("difference", -1.0)):
                yield SpringHypothesis(
                    arm=arm, site=Site.joint(i), joints=(i, j), form=form, sign=sign,
                    setting={"ratio": float(arm.scale[i] / arm.scale[j])},
                    middle=(float(middle[i]), float(middle[j])),
                    half=(float(half[i]), float(half[j])),
                )  # fmt: skip


@dataclass(frozen=True, eq=False, kw_only=True)
class SpringHypothesis(Hypothesis):
    """A spring between two joints, which u = q_i + sign ratio q_j stretches.

    Its torque is k u + c at the first joint and sign ratio (k u + c) at the second: both from the
    potential k u^2 / 2 + c u.

    Attributes:
        sign: +1 or -1.
        middle: Of the ways of both joints, rad: c is the torque there.
        half: How far they go from there, rad.
    """

    EFFECT = JointSpring
    CLAIM = (
        "a spring spans {joint} and {other}, stretched by the {form} of their positions: "
        "{stiffness} stiffness at {joint} than {model}"
    )

    sign: float
    middle: tuple[float, float]
    half: tuple[float, float]
    refine = ("ratio",)

    @property
    def _row(self) -> Array:
        """(n,) row from positions to the stretch of the spring."""
        first, second = self.joints
        unit = np.eye(self.arm.n)
        return unit[first] + self.sign * self.setting["ratio"] * unit[second]

    def regressor(self, motion: Motion) -> Array:
        """Return torques per stiffness, and per torque in the middle of the motion."""
        row = self._row
        stretch = motion.q @ row - self.middle @ row[list(self.joints)]
        return spread(row, stretch, np.ones_like(stretch))

    def parameters(self, theta: Array) -> dict[str, float]:
        stiffness, torque = theta.tolist()
        return {"stiffness": stiffness, "ratio": self.setting["ratio"], "torque": torque}

    def plausible(self, theta: Array) -> bool:
        """It must pull more as it is stretched."""
        stiffness, torque = np.abs(theta).tolist()
        furthest = self.half[0] + self.setting["ratio"] * self.half[1]
        return stiffness * furthest >= _GROWS * torque and super().plausible(theta)

    def merge(self, values: Values, theta: Array, motion: Motion) -> Values:
        """Add the spring, as a function of true positions."""
        row, n = self._row, self.arm.n
        more = float(theta[0]) * np.outer(row, row)
        from_middle = position_offset(self.arm, values)
        from_middle[list(self.joints)] -= self.middle
        result = dict(values)
        for joint in self.joints:
            name = f"{self.effect}.{self.arm.joint_names[joint]}"
            result[name] = as_value(as_array(values.get(name), n, 0.0) + more[joint])
        name = f"{self.effect}.constant"
        constant = as_array(values.get(name), n, 0.0) + more @ from_middle + float(theta[1]) * row
        return {**result, name: as_value(constant)}
