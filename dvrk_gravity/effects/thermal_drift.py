"""Torque that changes with the time that an arm has been on."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.effects.base.effect import Effect, Hypothesis, spread
from dvrk_gravity.effects.base.meaning import Meaning, meanings
from dvrk_gravity.effects.base.motion import Motion
from dvrk_gravity.effects.base.site import Site

_TIMES = (4.0, 10.0, 25.0, 60.0)  # s, from which the search begins


class ThermalDrift(Effect):
    """tau = torque (1 - exp(-t / time_constant)): drives and grease that warm up."""

    NAME = "thermal_drift"
    REMEDY = "let the arm warm up before it is recorded, or calibrate warm"
    MEANINGS = meanings(
        torque=Meaning("N·m", 0.0, ("up", "down"), "drifts"), time_constant=Meaning("s", least=0.0)
    )

    @classmethod
    def hypotheses(cls, motion: Motion) -> Iterator[Hypothesis]:
        if motion.static:
            return
        for joint in np.flatnonzero(motion.present).tolist():
            for constant in _TIMES:
                yield DriftHypothesis(
                    arm=motion.arm, site=Site.joint(joint),
                    setting={"time_constant": constant},
                )  # fmt: skip


@dataclass(frozen=True, eq=False, kw_only=True)
class DriftHypothesis(Hypothesis):
    """A joint's torque drifts from a level of its own; in time, so no model file carries it.

    Time is counted from the first sample: stamps may be seconds since 1970.
    """

    EFFECT = ThermalDrift
    CLAIM = "the torque of {joint} drifts {torque} with time (time constant {time_constant})"

    refine = ("time_constant",)
    variable = "time"
    n_comparisons = len(_TIMES)
    transient = True

    def regressor(self, motion: Motion) -> Array:
        rise = 1.0 - np.exp(-(motion.time - motion.time[0]) / self.setting["time_constant"])
        return spread(self.site.row(self.arm), rise, np.ones(len(rise)))

    def parameters(self, theta: Array) -> dict[str, float]:
        return {"torque": float(theta[0]), "time_constant": self.setting["time_constant"]}

    @property
    def separated_by(self) -> str:
        return "a longer recording, begun with a cold arm, would separate them"
