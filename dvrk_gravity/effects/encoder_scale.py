"""Encoders that read too far or too short: wrong counts per turn, gear ratio or pitch."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.effects.base.arrays import Values, as_value, position_offset
from dvrk_gravity.effects.base.effect import Hypothesis
from dvrk_gravity.effects.base.meaning import READS, Meaning, meanings
from dvrk_gravity.effects.base.motion import Motion
from dvrk_gravity.effects.base.reading_errors import ReadingErrors
from dvrk_gravity.effects.base.sensor import FactorEffect
from dvrk_gravity.effects.base.site import encoder_sites

# Chosen: beyond, it is another unit or a wrong sign. A fit on its way may ask even for zero.
_LEAST, _GREATEST = 0.5, 2.0
_SMALL = 1e-3  # of a factor less one, and rad: below, a slope replaces the secant


class EncoderScale(FactorEffect):
    """measured position = factor x true position + offset, and measured velocity likewise.

    The offset is zero where the joint is homed at the encoder's zero. Where it is homed at z, the
    reading is right there, and the offset is (1 - factor) z. Unlike ``time_scale`` it concerns one
    encoder, and unlike ``joint_offset`` it grows with the joint's travel.
    """

    NAME = "encoder_scale"
    FACTORS = "reading.encoder_scale"
    FACTOR_OF = "position"
    FACTOR_MEANING = "measured over true position and velocity"
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
                setting={"factor": 1.0, "offset": 0.0},
            )  # fmt: skip


@dataclass(frozen=True, eq=False, kw_only=True)
class ReadingHypothesis(Hypothesis):
    """The encoder of a joint or a motor reads another angle than it turned by."""

    EFFECT = EncoderScale
    CLAIM = "the encoder of {where} reads {factor}"

    shifts_positions = True

    @property
    def fixed_point(self) -> tuple[str, ...]:
        return tuple(self.setting)

    def regressor(self, motion: Motion) -> Array:
        """Return secants of the torque by the factor and, homed elsewhere, by the offset."""
        factor = float(np.clip(self.setting["factor"], _LEAST, _GREATEST))
        scaled = partial(self._torque, motion, offset=0.0)
        columns = [_secant(scaled, 1.0, factor, motion.modelled)]
        offset = self.setting.get("offset")
        if offset == 0.0 and factor == 1.0:
            columns.append(-motion.slope @ self.site.column(self.arm))
        elif offset is not None:
            shifted = partial(self._torque, motion, factor)
            columns.append(_secant(shifted, 0.0, offset))
        return np.stack(columns, axis=2)

    def _torque(self, motion: Motion, factor: float, offset: float) -> Array:
        """Return (N, n) torques of the model if the encoder reads factor x true + offset."""
        true = self._true(factor)
        q = (motion.q - offset * self.site.column(self.arm)) @ true
        state = motion.state_at(q)
        if not motion.static:
            state = replace(state, qd=motion.qd @ true, qdd=motion.qdd @ true)
        torque: Array = motion.model.torque_at(state)
        return torque

    def _true(self, factor: float) -> Array:
        """Return the (n, n) map by which read positions, as rows, become true ones."""
        # The encoder reads a row of the joints' positions, and its correction moves a column.
        row, column = self.site.row(self.arm), self.site.column(self.arm)
        return np.eye(self.arm.n) + (1.0 / factor - 1.0) * np.outer(row, column)

    def reading_errors(self, theta: Array) -> ReadingErrors:
        row, column = self.site.row(self.arm), self.site.column(self.arm)
        right = ReadingErrors.none(self.arm.n)
        return replace(right, position=right.position + float(theta[0]) * np.outer(column, row))

    def merge(self, values: Values, theta: Array, motion: Motion) -> Values:
        """Return a model with the reading at the encoder's zero, as the zero of a joint."""
        shift = self.site.column(self.arm) @ self._true(1.0 + float(theta[0]))
        zeros = position_offset(self.arm, values) + theta[1:].sum() * shift
        return {**values, "joint_offset": as_value(zeros)} if zeros.any() else values

    def parameters(self, theta: Array) -> dict[str, float]:
        part, *offset = theta.tolist()
        return {"factor": 1.0 + part, **({"offset": offset[0]} if offset else {})}


def _secant(
    torque: Callable[[float], Array], start: float, at: float, there: Array | None = None
) -> Array:
    """Return the (N, n) secant of a torque from a start, near that its slope.

    Args:
        torque: The torque by a setting.
        start: Its value without the fault.
        at: Its value.
        there: The torque at the start, where it is known.
    """
    if abs(at - start) < _SMALL:
        return (torque(start + _SMALL) - torque(start - _SMALL)) / (2.0 * _SMALL)
    return (torque(at) - (torque(start) if there is None else there)) / (at - start)
