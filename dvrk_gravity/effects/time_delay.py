"""Efforts and positions that are stamped apart."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.effects.base import site
from dvrk_gravity.effects.base.effect import Effect, Hypothesis, Setting
from dvrk_gravity.effects.base.evidence import Motion
from dvrk_gravity.effects.base.meaning import Meaning, meanings

Array = NDArray[np.float64]

_SMALL = 1e-3  # s: below, a slope serves in place of a secant
_FIRST = 0.01  # s, first guess


class TimeDelay(Effect):
    """The effort of a sample is that of another time than its position."""

    NAME = "time_delay"
    REMEDY = "stamp positions and efforts together, or delay the positions as much before a fit"
    MEANINGS = meanings(
        delay=Meaning("s", 0.0, ("late", "early"), "efforts are", least=-0.3, greatest=0.3)
    )

    @classmethod
    def hypotheses(cls, motion: Motion) -> Iterator[Hypothesis]:
        """See :meth:`Effect.hypotheses`."""
        if not motion.static:
            yield DelayHypothesis(arm=motion.arm, site=site.THE_ARM, setting={"delay": 0.0})


@dataclass(frozen=True, eq=False, kw_only=True)
class DelayHypothesis(Hypothesis):
    """Efforts are late against positions; to be put right where they are stamped."""

    EFFECT = TimeDelay
    CLAIM = "efforts and positions are stamped apart, efforts {delay}"

    form: str = "effort"
    fixed_point: tuple[str, ...] = ("delay",)
    variable: str = "time"
    of_state: bool = False

    def build(self, motion: Motion, setting: Setting) -> Array:
        """See :meth:`Hypothesis.build`.

        Of the model's torques: the measured ones hold noise that the residual holds, too, and a
        shift of them would explain it.
        """
        step = setting["delay"] if abs(setting["delay"]) > _SMALL else _FIRST
        late = np.empty_like(motion.acting)
        for part in motion.parts:
            time = motion.time[part]
            for joint, torque in enumerate(motion.acting[part].T):
                late[part, joint] = np.interp(time - step, time, torque)
        return ((late - motion.acting) / step)[:, :, None]

    def describe(self, theta: Array, setting: Setting) -> dict[str, float]:
        """See :meth:`Hypothesis.describe`."""
        del setting
        return {"delay": float(theta[0])}
