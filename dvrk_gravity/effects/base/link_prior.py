"""What links plausibly weigh, and which combinations of their parameters torque can show."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from dvrk_gravity import gravity
from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects.base import rigid_body

_RANK = 1e-9  # of a norm, that rounding leaves of what others make up
_MASS = 1.0  # kg, of a link of which nothing is known
_EXTENT = 0.1  # m, likewise
_LEAST = 0.05  # of the heaviest link's nominal mass, that a light one may be off by


@lru_cache(maxsize=8)
def link_sizes(arm: Arm) -> tuple[tuple[float, float], ...]:
    """Return plausible mass, kg, and extent, m, of each body, for a prior of its parameters.

    They are those that the arm's file gives; of an arm whose file brings nominal parameters they
    are those parameters' own; of others a link is as long as the way to the farthest one that it
    carries.
    """
    nominal = arm.inertial_parameters
    least = 0.0 if nominal is None else _LEAST * float(nominal[:, 0].max())
    sizes = []
    for index, body in enumerate(arm.body_names):
        if body in arm.sizes:
            sizes.append(arm.sizes[body])
            continue
        ways = [
            float(np.linalg.norm(other.placement.translation))
            for other in arm.bodies
            if other.parent == index
        ]
        mass, extent = _MASS, max([*ways, _EXTENT])
        if nominal is not None:
            mass = max(float(nominal[index, 0]), least)
            radius = np.sqrt(max(nominal[index, [4, 6, 9]].sum(), 0.0) / (2.0 * mass))
            extent = max(extent, float(radius))
        sizes.append((mass, extent))
    return tuple(sizes)


@lru_cache(maxsize=8)
def samples(arm: Arm) -> tuple[Array, Array, Array]:
    """Return (200, n) random positions within the limits, velocities and accelerations."""
    random = np.random.default_rng(0)
    q = random.uniform(*arm.range, (200, arm.n))
    qd, qdd = random.normal(size=(2, 200, arm.n)) * np.array([[[2.0]], [[10.0]]])
    return q, qd, qdd


def prior_scale(arm: Arm) -> Array:
    """Return (10 bodies,) plausible sizes of the links' parameters."""
    return np.concatenate(
        [
            np.array([mass, *[mass * size] * 3, *[mass * size**2] * 6])
            for mass, size in link_sizes(arm)
        ]
    )


@lru_cache(maxsize=8)
def base_directions(arm: Arm, absent: tuple[int, ...] = ()) -> Array:
    """Return (10 bodies, b): the b combinations of link parameters that torque can show at all.

    Columns are scaled so that a Gaussian of unit variance on each is, as far as torque can
    tell, the prior of independent link parameters of the plausible sizes above: what the
    data leave open stays near "no mass" and in proportion to those sizes. The number b comes
    from a rank-revealing QR with column pivoting (Gautier 1991) of the regressor at random motion.

    Args:
        arm: The arm.
        absent: Link parameters that are zero.
    """
    scale = prior_scale(arm)
    scale[list(absent)] = 0.0
    return _that_act(rigid_body.regressor(arm, *samples(arm), arm.gravity), scale)


@lru_cache(maxsize=8)
def weight_directions(arm: Arm) -> Array:
    """Return (4 bodies, b): as :func:`base_directions`, of masses and first moments at rest."""
    scale = prior_scale(arm).reshape(len(arm.bodies), -1)[:, : rigid_body.OF_WEIGHT].ravel()
    return _that_act(rigid_body.weight_regressor(arm, samples(arm)[0], arm.gravity), scale)


def _that_act(regressor: Array, scale: Array) -> Array:
    """Return (p, b) combinations, of unit prior size, of the parameters that a regressor shows."""
    from scipy.linalg import qr

    full = regressor.reshape(-1, len(scale)) * scale
    diagonal = np.abs(np.diag(qr(full, mode="r", pivoting=True)[0]))
    rank = int(np.sum(diagonal > _RANK * diagonal[0]))
    directions = np.linalg.svd(full, full_matrices=False)[2][:rank].T
    return scale[:, None] * directions


@lru_cache(maxsize=8)
def rotors_beside_links(arm: Arm) -> tuple[int, ...]:
    """Return the motors whose rotors' torque is none that links could have.

    The others' inertia is a part of a link's, as far as torque can tell.
    """
    q, qd, qdd = samples(arm)
    links = rigid_body.regressor(arm, q, qd, qdd, arm.gravity) @ base_directions(arm)
    basis = np.linalg.qr(links.reshape(-1, links.shape[-1]))[0]
    found = []
    for motor, row in enumerate(arm.joint_to_actuator):
        torque = np.outer(qdd @ row, row).ravel()
        beside = torque - basis @ (basis.T @ torque)
        if np.linalg.norm(beside) > _RANK * np.linalg.norm(torque):
            found.append(motor)
    return tuple(found)


@lru_cache(maxsize=8)
def beta_map(arm: Arm) -> Array:
    """Return (12 or 14, 90): beta in N·m of an MTM from its links' parameters."""
    tilted = bool(np.abs(arm.gravity[:2]).max() > 1e-9)
    q = samples(arm)[0]
    weight = rigid_body.regressor(arm, q, None, None, arm.gravity)
    y = gravity.regressor(q, arm.gravity, 14 if tilted else 12)
    rows = q.size
    return np.asarray(np.linalg.lstsq(y.reshape(rows, -1), weight.reshape(rows, -1), rcond=None)[0])
