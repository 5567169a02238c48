"""Efforts that read no more than a limit."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects.base.arrays import as_array, as_value, joint_array
from dvrk_gravity.effects.base.effect import Hypothesis
from dvrk_gravity.effects.base.meaning import Meaning, meanings
from dvrk_gravity.effects.base.motion import Motion
from dvrk_gravity.effects.base.reading_errors import ReadingErrors
from dvrk_gravity.effects.base.sensor import SensorEffect
from dvrk_gravity.effects.base.site import Site
from dvrk_gravity.parameters import Parameter, Value

_PERCENTILES = (90.0, 95.0, 98.0, 99.5)  # of the measured effort, where limits are tried


class EffortSaturation(SensorEffect):
    """Measured effort clipped at a limit."""

    NAME = "effort_saturation"
    LIMIT = "reading.effort_limit"
    REMEDY = "move {joint} more gently, or raise its effort limit"
    MEANINGS = meanings(
        limit=Meaning("N·m", least=0.0),
        # Of what the limit would cut; all of it, or it is no limit.
        share=Meaning(least=0.6, greatest=1.4, reported=False),
    )

    @classmethod
    def schema(cls, arm: Arm) -> tuple[Parameter, ...]:
        meaning = "measured efforts are clipped there; 0: they are not"
        return (joint_array(arm, cls.LIMIT, "N·m", meaning, lower=0.0),)

    @classmethod
    def read(cls, arm: Arm, values: Mapping[str, Value], errors: ReadingErrors) -> ReadingErrors:
        limit = as_array(values.get(cls.LIMIT), arm.n, 0.0)
        return replace(errors, limit=np.where(limit > 0.0, limit, np.inf))

    @classmethod
    def written(cls, arm: Arm, errors: ReadingErrors) -> dict[str, Value]:
        known = np.isfinite(errors.limit)
        return {cls.LIMIT: as_value(np.where(known, errors.limit, 0.0))} if known.any() else {}

    @classmethod
    def hypotheses(cls, motion: Motion) -> Iterator[Hypothesis]:
        for joint in np.flatnonzero(motion.present).tolist():
            for percentile in _PERCENTILES:
                limit = float(np.percentile(np.abs(motion.effort[:, joint]), percentile))
                if limit > 0.0:
                    yield ClippedHypothesis(
                        arm=motion.arm, site=Site.joint(joint),
                        setting={"limit": limit},
                    )  # fmt: skip


@dataclass(frozen=True, eq=False, kw_only=True)
class ClippedHypothesis(Hypothesis):
    """A joint's effort is clipped."""

    EFFECT = EffortSaturation
    CLAIM = "the effort of {joint} is clipped at {limit}"

    refine = ("limit",)
    n_comparisons = len(_PERCENTILES)

    def regressor(self, motion: Motion) -> Array:
        joint, limit = self.site.index, self.setting["limit"]
        torque = np.zeros((*motion.q.shape, 1))
        modelled = motion.applied_torque[:, joint]
        torque[:, joint, 0] = np.clip(modelled, -limit, limit) - modelled
        return torque

    def reading_errors(self, theta: Array) -> ReadingErrors:
        right = ReadingErrors.none(self.arm.n)
        here = np.arange(self.arm.n) == self.site.index
        return replace(right, limit=np.where(here, self.setting["limit"], right.limit))

    def parameters(self, theta: Array) -> dict[str, float]:
        return {"limit": self.setting["limit"], "share": float(theta[0])}

    def search_range(self, name: str, motion: Motion) -> tuple[float, float]:
        return 0.9 * self.setting[name], 1.1 * self.setting[name]
