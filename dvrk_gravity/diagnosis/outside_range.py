"""Findings that lie where the model was not identified: they may be its own error there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.diagnosis.motion import MeasuredMotion
from dvrk_gravity.effects import Hypothesis, Kind

REMEDY = "identify from a recording that goes there, too, and diagnose again"


@dataclass(frozen=True)
class BeyondSettings:
    """When a finding lies beyond the range of a model.

    Attributes:
        share: Part of the square of its torque that does. Chosen: nearly all.
    """

    share: float = 0.9


def beyond_range(motion: MeasuredMotion, hypothesis: Hypothesis, theta: Array) -> str:
    """Return that a finding acts where the model was not identified, if it does; else ``""``.

    Of what is of a joint and depends on its position: a cable has any course there.

    Args:
        motion: The motion.
        hypothesis: The finding's.
        theta: (k,) its parameters.
    """
    known, joint = motion.model.uncertainty, hypothesis.site.index
    at_joint = hypothesis.site.kind is Kind.JOINT and hypothesis.variable == "position"
    if known is None or motion.model.of_file or not at_joint or not np.size(theta):
        return ""
    columns = hypothesis.regressor(motion)[:, joint]
    square, q = (columns @ theta) ** 2, motion.true_q[:, joint]
    low, high = float(known.lower[joint]), float(known.upper[joint])
    least = BeyondSettings().share * square.sum()
    if square[(q < low) | (q > high)].sum() <= least:
        return ""
    where = motion.arm.joints[joint]
    span = f"{where.shown(low).split()[0]} to {where.shown(high)} of {where.name}"
    return f"it acts outside {span}, where the model was not identified"
