"""Encoders whose zeros are off."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.effects.base.arrays import Values, position_offset
from dvrk_gravity.effects.base.effect import Effect, Hypothesis
from dvrk_gravity.effects.base.meaning import READS, Meaning, meanings
from dvrk_gravity.effects.base.motion import Motion
from dvrk_gravity.effects.base.site import Kind, Site, mixed_motors

_SMALL = 1e-3  # rad: below, a slope serves in place of a secant


class JointOffset(Effect):
    """measured position = true position + offset."""

    NAME = "joint_offset"
    REMEDY = "calibrate {joint}'s zero again (its potentiometer or homing)"
    MEANINGS = meanings(
        offset=Meaning("rad", 0.0, READS, "reads", least=-0.6, greatest=0.6),
    )

    @classmethod
    def hypotheses(cls, motion: Motion) -> Iterator[Hypothesis]:
        """Of a joint, and of a motor that moves several.

        None of what did not move: a constant torque at other joints is all that it would show.
        """
        arm, moves = motion.arm, motion.moves
        sites = [Site.joint(joint) for joint in np.flatnonzero(moves).tolist()]
        if motion.present.all():
            sites += [
                Site.motor(motor)
                for motor in mixed_motors(arm)
                if moves[arm.actuator_to_joint[:, motor] != 0.0].any()
            ]
        for where in sites:
            yield ZeroHypothesis(
                arm=arm, site=where, joints=(where.index,), setting={"offset": 0.0},
                alignment=where.kind is Kind.JOINT,
            )  # fmt: skip


@dataclass(frozen=True, eq=False, kw_only=True)
class ZeroHypothesis(Hypothesis):
    """The encoder of a joint or a motor has another zero than the model takes it to have."""

    EFFECT = JointOffset
    CLAIM = "the encoder of {where} reads {offset}"

    fixed_point: tuple[str, ...] = ("offset",)
    shifts_positions: bool = True

    @property
    def shift(self) -> Array:
        """(n,) what the joints' positions read too much per rad of it."""
        if self.site.kind is Kind.MOTOR:
            return self.arm.actuator_to_joint[:, self.site.index]
        return self.site.row(self.arm)

    def regressor(self, motion: Motion) -> Array:
        """A secant at the last estimate serves large offsets."""
        step = self.setting["offset"]
        if abs(step) < _SMALL:
            return -(motion.slope @ self.shift)[:, :, None]
        there = motion.torque_at(motion.q - step * self.shift)
        return ((there - motion.modelled) / step)[:, :, None]

    def parameters(self, theta: Array) -> dict[str, float]:
        return {"offset": float(theta[0])}

    def merge(self, values: Values, theta: Array, motion: Motion) -> Values:
        del motion
        total = position_offset(self.arm, values) + float(theta[0]) * self.shift
        return {**values, self.effect: tuple(total.tolist())}

    @property
    def subject(self) -> str:
        return f"the zero of {self.site.words(self.arm)}"
