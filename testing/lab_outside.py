"""Disturbances that no effect of the vocabulary is, to see that none is named for certain.

They are sized as those of ``lab_effects``, by what a good model leaves.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from testing.hidden_parts import found
from testing.lab_effects import Array, Hiding, Random, Setting, Shaper


def _added(setting: Setting, joint: int, shape: Array, target: float, name: str) -> Hiding:
    """Add (T,) a torque of one joint that is as large as it is to be."""
    truth = setting.truth
    unit = np.zeros_like(truth.effort)
    unit[:, joint] = shape
    size = setting.ratio(unit)
    factor = target / max(size, 1e-12)
    return Hiding(
        replace(truth, effort=truth.effort + factor * unit),
        found(truth.arm, name, joint), factor * size,
    )  # fmt: skip


def _half_drag(setting: Setting, random: Random, joint: int, target: float) -> Hiding:
    """Let a joint be damped in one part of its way only."""
    q, qd = setting.truth.q[:, joint], setting.truth.qd[:, joint]
    shape = qd * (q > np.quantile(q, random.uniform(0.4, 0.6)))
    return _added(setting, joint, shape, target, "half_drag")


def _creep(setting: Setting, random: Random, joint: int, target: float) -> Hiding:
    """Let an elastic torque fade within seconds where a joint rests: a cable's sheath creeps."""
    time, q = setting.truth.time, setting.truth.q[:, joint]
    step, constant = float(time[1] - time[0]), float(random.uniform(0.5, 3.0))
    rested, left = np.empty_like(q), float(np.exp(-step / constant))
    at = q[0]
    for row, position in enumerate(q):
        at = position + (at - position) * left
        rested[row] = at
    return _added(setting, joint, q - rested, target, "creep")


OUTSIDE: Mapping[str, Shaper] = {
    "half_drag": _half_drag,
    "creep": _creep,
}
"""Disturbance -> how it is hidden."""
