"""Encoders that read too far or too short: counts a turn, a gear ratio, a pitch that are wrong."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.effects.base.effect import Effect, Hypothesis, Setting
from dvrk_gravity.effects.base.encoder_sites import encoder_sites
from dvrk_gravity.effects.base.evidence import Motion
from dvrk_gravity.effects.base.meaning import Meaning, meanings
from dvrk_gravity.effects.base.state import State

Array = NDArray[np.float64]

_SMALL = 1e-3  # of a factor: nearer to one, a slope serves in place of a secant


class EncoderScale(Effect):
    """measured position = factor x true position, of velocity and acceleration likewise.

    Positions count from the encoder's zero. Where a joint is homed elsewhere, the reading is off by
    a constant as well, which is a ``joint_offset``. Unlike a ``time_scale`` it is of one encoder.
    """

    NAME = "encoder_scale"
    REMEDY = "check the counts per turn and the gear ratio of {joint}'s encoder"
    MEANINGS = meanings(
        factor=Meaning(
            "", 1.0, ("too far", "too short"), "reads", least=0.5, greatest=2.0, percent=True
        )
    )

    @classmethod
    def hypotheses(cls, motion: Motion) -> Iterator[Hypothesis]:
        """See :meth:`Effect.hypotheses`: of a joint, and of a motor that moves several."""
        for where in encoder_sites(motion):
            yield ReadingHypothesis(
                arm=motion.arm, site=where, joints=(where.index,), setting={"factor": 1.0}
            )


@dataclass(frozen=True, eq=False, kw_only=True)
class ReadingHypothesis(Hypothesis):
    """The encoder of a joint or a motor reads another angle than it turned by."""

    EFFECT = EncoderScale
    CLAIM = "the encoder of {where} reads {factor}"

    fixed_point: tuple[str, ...] = ("factor",)

    def build(self, motion: Motion, setting: Setting) -> Array:
        """See :meth:`Hypothesis.build`: a secant of the model's torque at the last estimate."""
        part = setting["factor"] - 1.0
        if abs(part) < _SMALL:
            change = self._torque(motion, 1.0 + _SMALL) - self._torque(motion, 1.0 - _SMALL)
            return (change / (2.0 * _SMALL))[:, :, None]
        return ((self._torque(motion, 1.0 + part) - motion.modelled) / part)[:, :, None]

    def _torque(self, motion: Motion, factor: float) -> Array:
        """Return (N, n) torques of the model where the encoder reads ``factor`` times too far."""
        # What the encoder reads is a row of the joints' positions; what it moves, a column of them.
        read = np.outer(self.site.row(self.arm), self.site.column(self.arm))
        true = np.eye(self.arm.n) + (1.0 / factor - 1.0) * read
        q = motion.q @ true
        if motion.static:
            state = State(q, direction=motion.direction)
        else:
            state = State(q, motion.qd @ true, motion.qdd @ true)
        torque: Array = motion.model.torque_at(state)
        return torque

    def describe(self, theta: Array, setting: Setting) -> dict[str, float]:
        """See :meth:`Hypothesis.describe`."""
        del setting
        return {"factor": 1.0 + float(theta[0])}
