"""Error measures, joint by joint."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dvrk_gravity.identification.result import JointError
from dvrk_gravity.recording.data import Array


def joint_errors(joints: Sequence[str], measured: Array, predicted: Array) -> dict[str, JointError]:
    """Return the error of (N, n) predictions against (N, n) measured torques, N·m, by joint."""
    residual = measured - predicted
    power = np.mean(residual**2, axis=0)
    size = np.mean(measured**2, axis=0)
    spread = np.var(measured, axis=0)
    return {
        joint: JointError(
            float(np.sqrt(power[k])),
            _ratio(np.sqrt(power[k]), np.sqrt(size[k])),
            1.0 - _ratio(power[k], spread[k]),
        )
        for k, joint in enumerate(joints)
    }


def _ratio(error: float, size: float) -> float:
    """Return error / size; where nothing was measured, 0 for no error and 1 for any."""
    return float(error / size) if size > 0.0 else float(error > 0.0)
