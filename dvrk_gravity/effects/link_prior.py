"""What links plausibly weigh, and which combinations of their parameters torque can show."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity import gravity
from dvrk_gravity.arm import N_JOINTS, Arm
from dvrk_gravity.effects import rigid_body
from dvrk_gravity.tree import TREE_LINKS

Array = NDArray[np.float64]

# Plausible size of each link, for the prior: mass kg, extent m.
SIZES = {
    "link1": (1.0, 0.15),
    "link2": (0.8, 0.3),
    "crank": (0.2, 0.1),
    "link3": (0.4, 0.35),
    "bar": (0.3, 0.3),
    "link4": (0.4, 0.2),
    "link5": (0.15, 0.12),
    "link6": (0.1, 0.08),
    "link7": (0.05, 0.04),
}


@lru_cache(maxsize=8)
def _samples(arm: Arm) -> tuple[Array, Array, Array]:
    """Return (200, 7) random positions within the limits, velocities and accelerations."""
    random = np.random.default_rng(0)
    q = random.uniform(arm.lower, arm.upper, (200, N_JOINTS))
    qd, qdd = random.normal(size=(2, 200, N_JOINTS)) * np.array([[[2.0]], [[10.0]]])
    return q, qd, qdd


def prior_scale() -> Array:
    """Return (90,) plausible sizes of the links' parameters."""
    return np.concatenate(
        [
            np.array([mass, *[mass * size] * 3, *[mass * size**2] * 6])
            for mass, size in (SIZES[body] for body in TREE_LINKS)
        ]
    )


@lru_cache(maxsize=8)
def base_directions(arm: Arm, absent: tuple[int, ...] = ()) -> Array:
    """Return (90, b): the b combinations of link parameters that torque can depend on at all.

    Columns are scaled so that a Gaussian of unit variance on each is, as far as torque can
    tell, the prior of independent link parameters of the plausible sizes above: what the
    data leave open stays near "no mass" and in proportion to those sizes. The number b comes
    from a rank-revealing QR with column pivoting (Gautier 1991) of the regressor at random motion.

    Args:
        arm: The arm.
        absent: Link parameters that are zero.
    """
    from scipy.linalg import qr

    scale = prior_scale()
    scale[list(absent)] = 0.0
    full = rigid_body.regressor(arm, *_samples(arm), arm.gravity).reshape(-1, len(scale)) * scale
    diagonal = np.abs(np.diag(qr(full, mode="r", pivoting=True)[0]))
    rank = int(np.sum(diagonal > 1e-9 * diagonal[0]))
    directions = np.linalg.svd(full, full_matrices=False)[2][:rank].T
    return scale[:, None] * directions


@lru_cache(maxsize=8)
def beta_map(arm: Arm) -> Array:
    """Return (12 or 14, 90): beta in N·m from the links' parameters."""
    tilted = bool(np.abs(arm.gravity[:2]).max() > 1e-9)
    q = _samples(arm)[0]
    weight = rigid_body.regressor(arm, q, None, None, arm.gravity).reshape(-1, rigid_body.COLUMNS)
    y = gravity.regressor(q, arm.gravity, 14 if tilted else 12)
    return np.asarray(np.linalg.lstsq(y.reshape(len(weight), -1), weight, rcond=None)[0])
