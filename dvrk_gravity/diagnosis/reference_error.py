"""By what two recordings of one motion may differ without a cause that is worth telling."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.diagnosis.motion import Motion

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ReferenceErrorSettings:
    """How friction may differ from the reference's.

    Attributes:
        by_load: Standard deviation of the part of the torque by which friction grows with what a
            joint transmits. Chosen: harmonic drives lose some per cent (Taghirad and Bélanger
            1998); two joints of a UR10e 7 and 8 % (docs/own_arm.md).
        by_day: Standard deviation of the part by which all friction is another. Chosen: friction
            falls with warmth, and the joints of a PSM differ so from one recording to the next.
    """

    by_load: float = 0.1
    by_day: float = 0.3


def reference_columns(motion: Motion, settings: ReferenceErrorSettings | None = None) -> Array:
    """Return (N, n, d) torques by which a difference may be off, of one standard deviation each.

    Of every joint that moves: friction of which the transmitted torque has grown, and friction
    that is another one.
    """
    settings = settings or ReferenceErrorSettings()
    joints = np.flatnonzero(motion.moves).tolist()
    grown = np.abs(motion.effort) - np.abs(motion.modelled)
    columns = np.zeros((*motion.q.shape, 2 * len(joints)))
    for index, joint in enumerate(joints):
        sign = motion.sign(np.eye(motion.arm.n)[joint])
        columns[:, joint, 2 * index] = settings.by_load * grown[:, joint] * sign
        # About as much as the reference's torque owes to the direction.
        moving = max(float(np.mean(sign**2)), 1e-9)
        owed = abs(float(np.mean(sign * motion.modelled[:, joint]))) / moving
        columns[:, joint, 2 * index + 1] = settings.by_day * owed * sign
    return columns
