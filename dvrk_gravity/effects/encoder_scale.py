"""Encoders that read too far or too short: wrong counts per turn, gear ratio or pitch."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.effects.base.effect import Effect, Hypothesis
from dvrk_gravity.effects.base.meaning import READS, Meaning, meanings
from dvrk_gravity.effects.base.motion import Motion, State
from dvrk_gravity.effects.base.site import encoder_sites

# Chosen: beyond, it is another unit or a wrong sign. A fit on its way may ask even for zero.
_LEAST, _GREATEST = 0.5, 2.0
_SMALL = 1e-3  # of a factor less one, and rad: below, a slope replaces the secant


class EncoderScale(Effect):
    """measured position = factor x true position + offset, and measured velocity likewise.

    The offset is zero where the joint is homed at the encoder's zero. Where it is homed at z, the
    reading is right there, and the offset is (1 - factor) z. Unlike ``time_scale`` it concerns one
    encoder, and unlike ``joint_offset`` it grows with the joint's travel.
    """

    NAME = "encoder_scale"
    REMEDY = "check the counts per turn and the gear ratio of {joint}'s encoder"
    MEANINGS = meanings(
        factor=Meaning(
            "", 1.0, ("too far", "too short"), "reads", _LEAST, _GREATEST, percent=True
        ),
        offset=Meaning("rad", None, READS, "reads at its zero", least=-0.6, greatest=0.6),
    )  # fmt: skip

    @classmethod
    def hypotheses(cls, motion: Motion) -> Iterator[Hypothesis]:
        """At each encoder, homed at its zero and elsewhere."""
        for site in encoder_sites(motion):
            at_zero = ReadingHypothesis(arm=motion.arm, site=site, setting={"factor": 1.0})
            yield at_zero
            yield replace(
                at_zero, form=f"{site.kind.value}, homed elsewhere",
                setting={"factor": 1.0, "offset": 0.0}, fixed_point=("factor", "offset"),
            )  # fmt: skip


@dataclass(frozen=True, eq=False, kw_only=True)
class ReadingHypothesis(Hypothesis):
    """The encoder of a joint or a motor reads another angle than it turned by."""

    EFFECT = EncoderScale
    CLAIM = "the encoder of {where} reads {factor}"

    fixed_point: tuple[str, ...] = ("factor",)

    def regressor(self, motion: Motion) -> Array:
        """Return secants of the torque by the factor and, homed elsewhere, by the offset."""
        factor = float(np.clip(self.setting["factor"], _LEAST, _GREATEST))
        columns = [_secant(lambda part: self._torque(motion, 1.0 + part, 0.0), factor - 1.0)]
        if "offset" in self.setting:
            offset = self.setting["offset"]
            columns.append(_secant(lambda shift: self._torque(motion, factor, shift), offset))
        return np.stack(columns, axis=2)

    def _torque(self, motion: Motion, factor: float, offset: float) -> Array:
        """Return (N, n) torques of the model if the encoder reads factor x true + offset."""
        # The encoder reads a row of the joints' positions, and its correction moves a column.
        row, column = self.site.row(self.arm), self.site.column(self.arm)
        true = np.eye(self.arm.n) + (1.0 / factor - 1.0) * np.outer(row, column)
        q = (motion.q - offset * column) @ true
        if motion.static:
            state = State(q, direction=motion.direction)
        else:
            state = State(q, motion.qd @ true, motion.qdd @ true)
        torque: Array = motion.model.torque_at(state)
        return torque

    def parameters(self, theta: Array) -> dict[str, float]:
        part, *offset = theta.tolist()
        return {"factor": 1.0 + part, **({"offset": offset[0]} if offset else {})}


def _secant(torque: Callable[[float], Array], at: float) -> Array:
    """Return the (N, n) secant of a torque from zero, near zero its slope."""
    if abs(at) < _SMALL:
        return (torque(_SMALL) - torque(-_SMALL)) / (2.0 * _SMALL)
    return (torque(at) - torque(0.0)) / at
