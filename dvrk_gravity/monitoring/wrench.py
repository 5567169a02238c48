"""The wrench at an arm's tip that external joint torques show, and what the pose does not show.

External torques tau = J' F + e of a wrench F, with errors e ~ N(0, S) and before any measurement
F ~ N(0, W), give the most probable wrench and its covariance

    F = (J S^-1 J' + W^-1)^-1 J S^-1 tau,    cov F = (J S^-1 J' + W^-1)^-1,

with the Jacobian J' from joint velocities to the tip's twist: a least-squares solution weighted by
what each joint is known to, damped by W^-1 (Tikhonov). Where a pose transmits nothing of a wrench's
direction to the joints, its estimate is zero and its deviation that of W.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from dvrk_gravity.arms import Arm, build_tree
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects import last_link
from dvrk_gravity.errors import ConfigError

AXES = ("force x", "force y", "force z", "moment x", "moment y", "moment z")

# Information of the torques on a direction, in units of what is known before (W^-1): as much as
# that halves the variance. A direction with less is known mostly by W: it is unobservable.
_OBSERVABLE = 1.0


@dataclass(frozen=True, eq=False)
class Wrench:
    """A wrench at the tip, in the tip's frame.

    Attributes:
        value: (6,) force in N and moment in N·m.
        covariance: (6, 6) of it.
        unobservable: (k, 6) unit directions, in the units of ``scale``, that the pose does not
            show; the largest component of each is positive.
        scale: (6,) N and N·m that count as one in directions.
    """

    value: Array
    covariance: Array
    unobservable: Array
    scale: Array

    @property
    def deviation(self) -> Array:
        """(6,) standard deviations, N and N·m."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    def unobservable_in_words(self) -> str:
        """Return the unobservable directions by their largest components; ``""``: none."""
        return "; ".join(_in_words(direction) for direction in self.unobservable)


class Tip:
    """Estimates wrenches at the tip of an arm.

    Attributes:
        link: Its link.
        scale: (6,) standard deviations of a wrench before any measurement, N and N·m: the force
            that the arm's strongest joint can hold at the arm's reach, and its moment.
    """

    def __init__(self, arm: Arm, link: str = "") -> None:
        """Take a link of the arm, by default its last one.

        Raises:
            ConfigError: No such link, one that does not move, or efforts that are not in N·m.
        """
        if arm.read_in:
            raise ConfigError("tip", link, f"an arm with efforts in N·m, not {arm.read_in}")
        self.link = link or last_link(arm)
        body, frame = arm.carrier(self.link)
        tree = build_tree(arm, {}, np.zeros(3))
        self._tree, self._joint = tree, body + 1
        self._frame = arm.bodies[body].frame * frame
        self.scale = _scale(arm, body, self._frame.translation)

    def jacobian(self, q: Array) -> Array:
        """Return the (6, n) Jacobian of the tip in its own frame at (n,) true positions.

        Links that follow others move with the joints that they follow.
        """
        tree = self._tree
        of_tree = pin.computeJointJacobian(tree.model, tree.data, tree.expand @ q, self._joint)
        return np.asarray(self._frame.actionInverse @ of_tree @ tree.expand)

    def velocity_jacobian(self, q: Array) -> Array:
        """Return (N, 3, n) Jacobians to the tip's velocity in the base at (N, n) true positions."""
        tree, found = self._tree, np.zeros((len(q), 3, q.shape[1]))
        for index, pose in enumerate(q):
            expanded = tree.expand @ pose
            pin.forwardKinematics(tree.model, tree.data, expanded)
            turned = tree.data.oMi[self._joint].rotation @ self._frame.rotation
            found[index] = turned @ self.jacobian(pose)[:3]
        return found

    def wrench(self, q: Array, torque: Array, deviation: Array) -> Wrench:
        """Return the wrench that acts on the arm.

        Args:
            q: (n,) true positions, rad or m.
            torque: (n,) external torques, N·m or N.
            deviation: (n,) standard deviations of these; ``inf`` where one says nothing.
        """
        jacobian = self.jacobian(q)
        weighted = self.scale[:, None] * jacobian / deviation
        values, vectors = np.linalg.eigh(weighted @ weighted.T)
        covariance = (vectors / (values + 1.0)) @ vectors.T
        value = self.scale * (covariance @ (weighted @ (torque / deviation)))
        hidden = vectors[:, values < _OBSERVABLE].T
        largest = np.take_along_axis(hidden, np.argmax(np.abs(hidden), axis=1)[:, None], axis=1)
        return Wrench(
            value, self.scale[:, None] * covariance * self.scale, hidden * np.sign(largest),
            self.scale,
        )  # fmt: skip


def _scale(arm: Arm, body: int, tip: Array) -> Array:
    """Return (6,) N and N·m that the arm's strongest joint can hold."""
    reach, index = float(np.linalg.norm(tip)), body
    while index >= 0:
        reach += float(np.linalg.norm(arm.bodies[index].placement.translation))
        index = arm.bodies[index].parent
    reach = max(reach, 1e-3)
    turns = np.array([joint.kind == "revolute" for joint in arm.joints])
    force = float(np.max(np.where(turns, arm.effort_limit / reach, arm.effort_limit)))
    return np.repeat([force, force * reach], 3)


def _in_words(direction: Sequence[float] | Array) -> str:
    parts = [
        f"{weight:+.1f} {axis}"
        for axis, weight in zip(AXES, np.asarray(direction).tolist(), strict=True)
        if abs(weight) >= 0.25
    ]
    return " ".join(parts)
