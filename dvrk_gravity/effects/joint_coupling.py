"""Torque or motion that leaks from one joint into another: a wrong transmission matrix."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.effects.base.effect import Effect, Hypothesis
from dvrk_gravity.effects.base.meaning import Estimate, Meaning, meanings
from dvrk_gravity.effects.base.motion import Motion
from dvrk_gravity.effects.base.site import Site

_SMALL = 1e-3  # below: a slope serves in place of a secant


class JointCoupling(Effect):
    """The reading of one joint contains a fraction of another's."""

    NAME = "joint_coupling"
    REMEDY = "check the transmission matrix (actuator to joint) at {joint}"
    MEANINGS = meanings(
        factor=Meaning("", 0.0, ("", "with the opposite sign"), "leaks", percent=True)
    )

    @classmethod
    def hypotheses(cls, motion: Motion) -> Iterator[Hypothesis]:
        present = np.flatnonzero(motion.present).tolist()
        for target in present:
            for source in present:
                if source == target:
                    continue
                name = motion.arm.joint_names[source]
                yield TorqueLeak(
                    arm=motion.arm, site=Site.joint(target), joints=(target, source),
                    form=f"torque of {name} leaks",
                )  # fmt: skip
                yield MotionLeak(
                    arm=motion.arm, site=Site.joint(target), joints=(target, source),
                    form=f"motion of {name} leaks", setting={"factor": 0.0},
                )  # fmt: skip


@dataclass(frozen=True, eq=False, kw_only=True)
class LeakHypothesis(Hypothesis):
    """A fraction of the second joint's torque or motion appears in the first joint's reading."""

    EFFECT = JointCoupling
    CLAIM = "{part} of {other}'s {what} leaks{turned} into the {read} read at {joint}"

    what: str
    read: str

    def parameters(self, theta: Array) -> dict[str, float]:
        return {"factor": float(theta[0])}

    @property
    def judged_at(self) -> tuple[int, ...]:
        return self.joints[:1]

    def claim(self, parameters: Mapping[str, Estimate]) -> str:
        joint, other = self.names
        factor = parameters["factor"]
        turned = ", with the opposite sign," if factor.value < 0.0 else ""
        return self.CLAIM.format(
            part=factor.magnitude.percent().shown, other=other, what=self.what, turned=turned,
            read=self.read, joint=joint,
        )  # fmt: skip


@dataclass(frozen=True, eq=False, kw_only=True)
class TorqueLeak(LeakHypothesis):
    """effort = torque + factor x the other joint's torque."""

    EFFORT_READING = True
    what: str = "torque"
    read: str = "effort"

    def regressor(self, motion: Motion) -> Array:
        target, source = self.joints
        torque = np.zeros((*motion.q.shape, 1))
        torque[:, target, 0] = motion.acting[:, source]
        return torque


@dataclass(frozen=True, eq=False, kw_only=True)
class MotionLeak(LeakHypothesis):
    """position = true position + factor x the other joint's position."""

    what: str = "motion"
    read: str = "position"
    fixed_point: tuple[str, ...] = ("factor",)

    def regressor(self, motion: Motion) -> Array:
        target, source = self.joints
        step = self.setting["factor"]
        if abs(step) < _SMALL:
            return -(motion.slope[:, :, target] * motion.q[:, [source]])[:, :, None]
        there = motion.q.copy()
        there[:, target] -= step * motion.q[:, source]
        return ((motion.torque_at(there) - motion.modelled) / step)[:, :, None]
