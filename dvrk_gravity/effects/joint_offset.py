"""Encoders whose zeros are off."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects.base.arrays import Values, as_value, position_offset
from dvrk_gravity.effects.base.column import MISPLACED, Column
from dvrk_gravity.effects.base.effect import Effect, Hypothesis
from dvrk_gravity.effects.base.meaning import READS, Meaning, meanings
from dvrk_gravity.effects.base.motion import Motion
from dvrk_gravity.effects.base.site import Site, encoder_sites, joints_with_weight

_SMALL = 1e-3  # rad: below, a slope replaces the secant


class JointOffset(Effect):
    """measured position = true position + offset."""

    NAME = "joint_offset"
    IN_FILES = ("urdf", "mjcf")
    REMEDY = "calibrate {joint}'s zero again (its potentiometer or homing)"
    MEANINGS = meanings(offset=Meaning("rad", 0.0, READS, "reads", least=-0.6, greatest=0.6))

    @classmethod
    def kinematic_columns(cls, arm: Arm) -> tuple[Column, ...]:
        """Return one of each joint whose zero torque shows.

        That of a joint that turns everything about the vertical is not shown, and the last one's
        is equivalent to parameters of its link.
        """
        return tuple(
            Column(cls.NAME, Site.joint(joint), 0, MISPLACED * float(arm.scale[joint]))
            for joint in joints_with_weight(arm)
            if joint < arm.n - 1
        )

    @classmethod
    def hypotheses(cls, motion: Motion) -> Iterator[Hypothesis]:
        for site in encoder_sites(motion):
            yield ZeroHypothesis(arm=motion.arm, site=site, setting={"offset": 0.0})

    @classmethod
    def unit_changes(cls, motion: Motion) -> Iterator[tuple[Hypothesis, Array]]:
        """Of each joint's encoder."""
        return ((each, np.ones(1)) for each in cls.hypotheses(motion) if each.of_joint)


@dataclass(frozen=True, eq=False, kw_only=True)
class ZeroHypothesis(Hypothesis):
    """The encoder of a joint or a motor has another zero than the model assumes."""

    EFFECT = JointOffset
    CLAIM = "the encoder of {where} reads {offset}"

    fixed_point = ("offset",)
    shifts_positions = True

    @property
    def alignment(self) -> bool:
        return self.of_joint

    def regressor(self, motion: Motion) -> Array:
        """Return the secant of the model's torque by the offset."""
        step, shift = self.setting["offset"], self.site.column(self.arm)
        if abs(step) < _SMALL:
            return -(motion.slope @ shift)[:, :, None]
        there = motion.torque_at(motion.q - step * shift)
        return ((there - motion.modelled) / step)[:, :, None]

    def parameters(self, theta: Array) -> dict[str, float]:
        return {"offset": float(theta[0])}

    def merge(self, values: Values, theta: Array, motion: Motion) -> Values:
        shift = float(theta[0]) * self.site.column(self.arm)
        return {**values, self.effect: as_value(position_offset(self.arm, values) + shift)}

    @property
    def subject(self) -> str:
        return f"the zero of {self.site.words(self.arm)}"
