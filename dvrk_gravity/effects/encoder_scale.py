"""Encoders that read too far or too short: counts a turn, a gear ratio, a pitch that are wrong."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.effects.base.effect import Effect, Hypothesis, Setting
from dvrk_gravity.effects.base.encoder_sites import encoder_sites
from dvrk_gravity.effects.base.evidence import Motion
from dvrk_gravity.effects.base.meaning import READS, Meaning, meanings
from dvrk_gravity.effects.base.state import State

Array = NDArray[np.float64]

# Chosen: beyond, it is another unit or a wrong sign. A fit on its way may ask even for zero.
_LEAST, _GREATEST = 0.5, 2.0
_SMALL = 1e-3  # of a factor less one, and rad: below, a slope serves in place of a secant


class EncoderScale(Effect):
    """measured position = factor x true position + offset, and measured velocity likewise.

    The offset is zero where the joint is homed at the encoder's zero. Where it is homed at z, the
    reading is right there, and the offset is (1 - factor) z. Unlike a ``time_scale`` it is of one
    encoder, and unlike a ``joint_offset`` it grows with the joint's way.
    """

    NAME = "encoder_scale"
    REMEDY = "check the counts per turn and the gear ratio of {joint}'s encoder"
    MEANINGS = meanings(
        factor=Meaning(
            "",
            1.0,
            ("too far", "too short"),
            "reads",
            least=_LEAST,
            greatest=_GREATEST,
            percent=True,
        ),
        offset=Meaning("rad", None, READS, "reads at its zero", least=-0.6, greatest=0.6),
    )

    @classmethod
    def hypotheses(cls, motion: Motion) -> Iterator[Hypothesis]:
        """See :meth:`Effect.hypotheses`: of a joint, and of a motor that moves several."""
        for where in encoder_sites(motion):
            at_zero = ReadingHypothesis(
                arm=motion.arm, site=where, joints=(where.index,), setting={"factor": 1.0}
            )
            yield at_zero
            yield replace(
                at_zero, form=f"{where.kind.value}, homed elsewhere",
                setting={"factor": 1.0, "offset": 0.0}, fixed_point=("factor", "offset"),
            )  # fmt: skip


@dataclass(frozen=True, eq=False, kw_only=True)
class ReadingHypothesis(Hypothesis):
    """The encoder of a joint or a motor reads another angle than it turned by."""

    EFFECT = EncoderScale
    CLAIM = "the encoder of {where} reads {factor}"

    fixed_point: tuple[str, ...] = ("factor",)

    def build(self, motion: Motion, setting: Setting) -> Array:
        """See :meth:`Hypothesis.build`: secants of the model's torque at the last estimate.

        Of the factor without an offset, and, where it is homed elsewhere, of the offset beside it.
        """
        factor = float(np.clip(setting["factor"], _LEAST, _GREATEST))
        offset = setting.get("offset")
        columns = [_secant(lambda part: self._torque(motion, 1.0 + part, 0.0), factor - 1.0)]
        if offset is not None:
            columns.append(_secant(lambda shift: self._torque(motion, factor, shift), offset))
        return np.stack(columns, axis=2)

    def _torque(self, motion: Motion, factor: float, offset: float) -> Array:
        """Return (N, n) torques of the model where the encoder reads so much too far, and high."""
        # What the encoder reads is a row of the joints' positions; what it moves, a column of them.
        row, column = self.site.row(self.arm), self.site.column(self.arm)
        true = np.eye(self.arm.n) + (1.0 / factor - 1.0) * np.outer(row, column)
        q = (motion.q - offset * column) @ true
        if motion.static:
            state = State(q, direction=motion.direction)
        else:
            state = State(q, motion.qd @ true, motion.qdd @ true)
        torque: Array = motion.model.torque_at(state)
        return torque

    def describe(self, theta: Array, setting: Setting) -> dict[str, float]:
        """See :meth:`Hypothesis.describe`."""
        del setting
        part, *offset = theta.tolist()
        return {"factor": 1.0 + part, **({"offset": offset[0]} if offset else {})}


def _secant(torque: Callable[[float], Array], at: float) -> Array:
    """Return the (N, n) secant of a torque from zero, near zero its slope."""
    if abs(at) < _SMALL:
        return (torque(_SMALL) - torque(-_SMALL)) / (2.0 * _SMALL)
    return (torque(at) - torque(0.0)) / at
