"""Encoders whose zeros are off."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.effects.base import site
from dvrk_gravity.effects.base.effect import Effect, Hypothesis, Setting, Values
from dvrk_gravity.effects.base.encoder_sites import encoder_sites
from dvrk_gravity.effects.base.evidence import Motion
from dvrk_gravity.effects.base.meaning import READS, Meaning, meanings
from dvrk_gravity.effects.base.merging import position_offset

Array = NDArray[np.float64]

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
        """See :meth:`Effect.hypotheses`: of a joint, and of a motor that moves several."""
        for where in encoder_sites(motion):
            yield ZeroHypothesis(
                arm=motion.arm, site=where, joints=(where.index,), setting={"offset": 0.0},
                alignment=where.kind is site.Kind.JOINT,
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
        return self.site.column(self.arm)

    def build(self, motion: Motion, setting: Setting) -> Array:
        """See :meth:`Hypothesis.build`; a secant at the last estimate serves large offsets."""
        step = setting["offset"]
        if abs(step) < _SMALL:
            return -(motion.slope @ self.shift)[:, :, None]
        there = motion.torque_at(motion.q - step * self.shift)
        return ((there - motion.modelled) / step)[:, :, None]

    def describe(self, theta: Array, setting: Setting) -> dict[str, float]:
        """See :meth:`Hypothesis.describe`."""
        del setting
        return {"offset": float(theta[0])}

    def merge(self, values: Values, theta: Array, motion: Motion) -> Values:
        """See :meth:`Hypothesis.merge`."""
        del motion
        total = position_offset(self.arm, values) + float(theta[0]) * self.shift
        return {**values, self.effect: tuple(total.tolist())}

    @property
    def subject(self) -> str:
        """See :meth:`Hypothesis.subject`."""
        return f"the zero of {self.site.words(self.arm)}"
