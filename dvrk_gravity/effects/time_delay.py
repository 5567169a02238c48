"""Efforts and positions that are stamped apart."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

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
    """Efforts are late against positions; to be put right where they are stamped.

    Attributes:
        of_friction: Whether the model's friction is late; ``None``: all that it has is.
    """

    EFFECT = TimeDelay
    OF_ACTING = True
    ERRORS_ADD = True
    CLAIM = "efforts and positions are stamped apart, efforts {delay}"

    of_friction: bool | None = None
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
        acting = motion.acting
        if self.of_friction is not None:
            acting = motion.friction if self.of_friction else acting - motion.friction
        late = np.empty_like(acting)
        for part in motion.parts:
            time = motion.time[part]
            for joint, torque in enumerate(acting[part].T):
                late[part, joint] = np.interp(time - step, time, torque)
        return ((late - acting) / step)[:, :, None]

    def must_show(self, motion: Motion) -> tuple[Hypothesis, ...]:
        """See :meth:`Hypothesis.must_show`.

        Friction that comes on over a way is late, too, where a joint turns back; but then weight
        and inertia are not.
        """
        if self.beside_reference or not any(term.FRICTION for term in motion.model.terms):
            return ()
        return replace(self, of_friction=False), replace(self, of_friction=True)

    def taken_in(self, motion: Motion) -> float:
        """See :meth:`Hypothesis.taken_in`, s^2: it looks like damping and mass.

        Of its calibration anything up to a sample, early or late, is usual and nobody sees it:
        uniform.
        """
        model = motion.model
        identified = model.uncertainty is not None and not model.of_file
        if not identified or self.beside_reference:
            return 0.0
        return float(np.median(np.diff(motion.time))) ** 2 / 3.0

    def describe(self, theta: Array, setting: Setting) -> dict[str, float]:
        """See :meth:`Hypothesis.describe`."""
        del setting
        return {"delay": float(theta[0])}
