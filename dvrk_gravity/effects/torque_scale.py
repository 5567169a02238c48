"""Efforts that read in wrong units, or with a wrong torque constant."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from dvrk_gravity.arms import ANY_UNIT
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects.base.effect import Hypothesis, remedy_text
from dvrk_gravity.effects.base.meaning import READS, Estimate, Meaning, Words, meanings
from dvrk_gravity.effects.base.motion import Motion
from dvrk_gravity.effects.base.reading_errors import ReadingErrors
from dvrk_gravity.effects.base.sensor import FactorEffect
from dvrk_gravity.effects.base.site import THE_ARM, Site, mixed_motors

_LEAST = 1e-3  # in place of zero: a factor is no number where a mean has nothing of the reference

_FAR = 4.0  # standard errors of drive gains. Chosen: all of them are not off by as much


class TorqueScale(FactorEffect):
    """measured effort = factor x applied effort."""

    NAME = "torque_scale"
    FACTORS = "reading.effort_scale"
    FACTOR_OF = "effort"
    FACTOR_MEANING = "measured over applied effort"
    REMEDY = "check {joint}'s torque constant, gear ratio and the scale of its current"
    MEANINGS = meanings(factor=Meaning("", 1.0, READS, least=0.2, greatest=5.0, percent=True))

    @classmethod
    def hypotheses(cls, motion: Motion) -> Iterator[Hypothesis]:
        """Of a joint, of all together, of a motor.

        None in an arbitrary unit: drives have gains of their own there, and a load that is heavier
        on one joint than on another shows their ratio, not a reading that changed.
        """
        arm = motion.arm
        if arm.read_in == ANY_UNIT:
            return
        unit = np.eye(arm.n)
        for joint in np.flatnonzero(motion.present).tolist():
            yield ScaleHypothesis(arm=arm, site=Site.joint(joint), mixing=np.diag(unit[joint]))
        if not motion.present.all():
            return
        yield ScaleHypothesis(
            arm=arm,
            site=THE_ARM,
            joints=tuple(range(len(unit))),
            form="all",
            mixing=unit,
        )
        for motor in mixed_motors(arm):
            mixing = arm.actuator_to_joint @ np.diag(unit[motor]) @ arm.joint_to_actuator
            yield ScaleHypothesis(arm=arm, site=Site.motor(motor), mixing=mixing)

    @classmethod
    def unit_changes(cls, motion: Motion) -> Iterator[tuple[Hypothesis, Array]]:
        """Of each joint's efforts."""
        return ((each, np.ones(1)) for each in cls.hypotheses(motion) if each.of_joint)


@dataclass(frozen=True, eq=False, kw_only=True)
class ScaleHypothesis(Hypothesis):
    """Efforts read too much or too little by a factor; to be put right where they are read.

    Attributes:
        mixing: (n, n) torques of the joints -> those that read wrongly, as the joints show them.
        each: Each of the joints by a factor of its own. One factor for all is compared with that,
            which is never found itself.
    """

    EFFECT = TorqueScale
    EFFORT_READING = True

    mixing: Array
    each: bool = False

    @property
    def unrestricted(self) -> ScaleHypothesis | None:
        one_for_all = self.site == THE_ARM and not self.each
        return replace(self, each=True, form="each") if one_for_all else None

    def regressor(self, motion: Motion) -> Array:
        if self.each:
            return motion.applied_torque[:, :, None] * np.eye(self.arm.n)[:, self.joints]
        return (motion.applied_torque @ self.mixing)[:, :, None]

    def parameters(self, theta: Array) -> dict[str, float]:
        if self.each:
            return {}
        part = float(theta[0])
        if not self.against_reference:
            return {"factor": 1.0 + part}
        # Part of the mean of both: s tau - tau = part (s tau + tau) / 2.
        return {"factor": (2.0 + part) / max(2.0 - part, _LEAST)}

    def reading_errors(self, theta: Array) -> ReadingErrors:
        part = self.parameters(theta)["factor"] - 1.0
        right = ReadingErrors.none(self.arm.n)
        return replace(right, effort=right.effort + part * self.mixing.T)

    def _claim(self, parameters: Mapping[str, Estimate], words: Words) -> str:
        if self.site == THE_ARM:
            return f"the efforts of all joints read {words['factor']}"
        return f"the effort of {self.site.words(self.arm)} reads {words['factor']}"

    def plausible(self, theta: Array) -> bool:
        """Known drive gains do not all share one large error."""
        error = self.arm.drive_gain_error
        if self.site == THE_ARM and error is not None and error.any():
            return bool(abs(theta[0]) <= _FAR * np.mean(error)) and super().plausible(theta)
        return super().plausible(theta)

    def remedy(self, carried: bool) -> str:
        """Masses that are all wrong by one factor have the same effect."""
        if self.site != THE_ARM:
            return super().remedy(carried)
        scale = remedy_text("check the scale of all efforts", carried, reading=True)
        if self.against_reference:
            return scale
        return f"{scale}; if it is right, all masses of the model are wrong by that factor"
