"""Error measures, joint by joint."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arrays import Array
from dvrk_gravity.identification.result import JointError

_NOTHING = 1e-300  # in place of a spread of zero


@dataclass(frozen=True)
class ConstantSettings:
    """When a prediction counts as better than a constant.

    Attributes:
        blocks: Consecutive ones, by whose sums the standard error is found: errors within one hang
            together. Chosen.
        deviations: Standard errors by which R² must be above 0: 95 % of constants are not.
    """

    blocks: int = 20
    deviations: float = 1.64


def joint_errors(
    joints: Sequence[str],
    measured: Array,
    predicted: Array,
    constant: Array | None = None,
    idle: NDArray[np.bool_] | None = None,
) -> dict[str, JointError]:
    """Return the errors of predictions against measured torques by joint.

    Args:
        joints: Names of the n joints.
        measured: (N, n) N·m or N.
        predicted: (N, n) likewise.
        constant: (n,) or (N, n) what is predicted without any model: the mean of what was fitted;
            ``None``: that of what was measured.
        idle: (n,) joints at which nothing acts that a prediction could show (``weights.idle``):
            they need not be predicted better than by a constant, unless no other joint is.
    """
    residual = measured - predicted
    power = np.mean(residual**2, axis=0)
    size = np.mean(measured**2, axis=0)
    spread = np.var(measured, axis=0)
    off = measured - (measured.mean(axis=0) if constant is None else constant)
    better = beats(residual**2, off**2, ConstantSettings())
    if idle is not None and (idle.all() or (better & ~idle).any()):
        better |= idle
    return {
        joint: JointError(
            float(np.sqrt(power[k])),
            _ratio(np.sqrt(power[k]), np.sqrt(size[k])),
            1.0 - _ratio(power[k], spread[k]),
            bool(better[k]),
        )
        for k, joint in enumerate(joints)
    }


def beats(error: Array, constant: Array, settings: ConstantSettings) -> NDArray[np.bool_]:
    """Return (n,) whether (N, n) squared errors are less than a constant's, surely."""
    blocks = [rows for rows in np.array_split(np.arange(len(error)), settings.blocks) if len(rows)]
    removed = np.array([(constant[rows] - error[rows]).sum(axis=0) for rows in blocks])
    share = removed.sum(axis=0) / np.maximum(constant.sum(axis=0), _NOTHING)
    by_block = np.array([constant[rows].sum(axis=0) for rows in blocks])
    spread = np.sqrt(((removed - share * by_block) ** 2).sum(axis=0))  # of a ratio of sums
    return np.asarray(removed.sum(axis=0) > settings.deviations * spread)


def _ratio(error: float, size: float) -> float:
    """Return error / size; where nothing was measured, 0 for no error and 1 for any."""
    return float(error / size) if size > 0.0 else float(error > 0.0)
