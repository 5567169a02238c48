"""How certain a fit is of the torque that holds the arm still: what a compensator sends."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.estimation import Uncertainty
from dvrk_gravity.identification.result import Holding


@dataclass(frozen=True)
class HoldingSettings:
    """How the torque that holds an arm still is judged.

    Attributes:
        poses: Drawn at random; the RMS of a standard error over N of them is known to about
            1 / sqrt(2 N), 5 %.
        narrow: Way below which a joint tells nothing that depends on its position, rad (times the
            arm's scale). Chosen: within 7.5 deg on either side a sine
            is a line to 0.3 %.
    """

    poses: int = 200
    narrow: float = float(np.radians(15.0))


def holding(
    rows: Callable[[Array], Array], theta: Array, spread: Uncertainty, visited: Array, arm: Arm
) -> dict[str, Holding]:
    """Return torque and standard error of holding still, by joint.

    At poses that were recorded (joints that hardly moved anywhere within their limits), and at
    poses anywhere within the arm's limits. What the data leave open the prior's size stands for.

    Args:
        rows: Turns (K, n) positions into (K, n, p) joint torques of each coefficient, at rest.
        theta: (p,) coefficients.
        spread: Their covariance.
        visited: (N, n) recorded positions, rad or m.
        arm: The arm.
    """
    settings = HoldingSettings()
    random = np.random.default_rng(0)
    lower, upper = visited.min(axis=0), visited.max(axis=0)
    anywhere = random.uniform(*arm.range, (settings.poses, visited.shape[1]))
    recorded = visited[random.integers(0, len(visited), settings.poses)]
    recorded = np.where(upper - lower < settings.narrow * arm.scale, anywhere, recorded)
    covariance = spread.covariance + spread.bias
    found = []
    for poses in (recorded, anywhere):
        columns = rows(poses)
        variance = np.einsum("kjp,pq,kjq->kj", columns, covariance, columns, optimize=True)
        torque = columns @ theta
        found += [
            np.sqrt(np.mean(torque**2, axis=0)),
            np.sqrt(np.maximum(variance, 0).mean(axis=0)),
        ]
    return {
        joint: Holding(*(float(values[k]) for values in (*found, lower, upper)))
        for k, joint in enumerate(arm.joint_names)
    }
