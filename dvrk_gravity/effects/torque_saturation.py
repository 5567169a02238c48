"""Motors whose torque constant falls as their iron saturates."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from dvrk_gravity.arms import ANY_UNIT
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects.base.effect import Effect, Hypothesis, spread
from dvrk_gravity.effects.base.meaning import Meaning, meanings
from dvrk_gravity.effects.base.motion import Motion
from dvrk_gravity.effects.base.site import Site

_MOST = 0.6  # of the torque constant that may be lost. Chosen: beyond, a drive limits its current
_LOADED = 0.2  # of a joint's effort limit. Chosen: motors are built to be linear up to their rating
_LEAST = 1e-3  # in place of zero, of what is left of a torque constant


class TorqueSaturation(Effect):
    """measured effort = tau (1 + c tau^2): a torque constant that falls as the torque grows.

    Efforts are currents times the torque constant of small currents. Torque is an odd function of
    the current, and iron that saturates bends it: K(i) = K (1 - b i^2 + ...), a parabola to leading
    order (Krishnan 2010, Permanent Magnet Synchronous and Brushless DC Motor Drives, on saturation
    and armature reaction). With tau the torque that acts, and e = K i the effort that is read,
    tau = e (1 - b i^2), so that e = tau (1 + c tau^2) to the same order, which is linear in c.
    Unlike of ``torque_scale`` small efforts are right, and unlike of ``effort_saturation`` the
    largest ones still grow.
    """

    NAME = "torque_saturation"
    REMEDY = (
        "correct {joint}'s efforts by its motor's curve of torque over current, or load it less"
    )
    MEANINGS = meanings(
        loss=Meaning("", 0.0, least=0.0, greatest=_MOST, percent=True),
        torque=Meaning("N·m", least=0.0),
    )

    @classmethod
    def hypotheses(cls, motion: Motion) -> Iterator[Hypothesis]:
        """Of each joint that is loaded enough: far below a motor's limit its iron is linear.

        None in an arbitrary unit, of which see TorqueScale.
        """
        if motion.arm.read_in == ANY_UNIT:
            return
        least = _LOADED * motion.arm.effort_limit
        for joint in np.flatnonzero(motion.present).tolist():
            largest = float(np.abs(motion.effort[:, joint]).max())
            if largest > least[joint]:
                yield SaturationHypothesis(
                    arm=motion.arm, site=Site.joint(joint), setting={"torque": largest}
                )


@dataclass(frozen=True, eq=False, kw_only=True)
class SaturationHypothesis(Hypothesis):
    """A joint's motor makes less torque of a large current than of small ones.

    The one parameter is by which part of it an effort is read too large at the recording's largest.
    """

    EFFECT = TorqueSaturation
    CLAIM = "the torque constant of {joint} falls by {loss} towards {torque}"
    EFFORT_READING = True

    def regressor(self, motion: Motion) -> Array:
        """Return tau^3 / T^2 with T the recording's largest effort."""
        acting = motion.applied_torque[:, self.site.index]
        cubed = acting * (acting / self.setting["torque"]) ** 2
        return spread(self.site.row(self.arm), cubed)

    def parameters(self, theta: Array) -> dict[str, float]:
        """Return the part of the constant that is lost at T, and T."""
        more = float(theta[0])
        return {"loss": more / max(1.0 + more, _LEAST), "torque": self.setting["torque"]}
