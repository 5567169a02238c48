"""How certain a fit is of the torque that holds the arm still: what a compensator sends."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.estimation.covariance import Uncertainty
from dvrk_gravity.identification.result import Holding
from dvrk_gravity.recording.data import Array

POSES = 200  # drawn; the standard error's RMS over them is then known to some 5 %
# A joint that moves by less tells nothing that depends on its position: rad, times the arm's scale.
NARROW = np.radians(15.0)


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
    random = np.random.default_rng(0)
    lower, upper = visited.min(axis=0), visited.max(axis=0)
    anywhere = random.uniform(*arm.range, (POSES, visited.shape[1]))
    recorded = visited[random.integers(0, len(visited), POSES)]
    recorded = np.where(upper - lower < NARROW * arm.scale, anywhere, recorded)
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
        joint: Holding(*(float(one[k]) for one in (*found, lower, upper)))
        for k, joint in enumerate(arm.joint_names)
    }
