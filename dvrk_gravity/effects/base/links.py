"""Inertial parameters of links: plausible sizes, what torque shows of them, single changes."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache

import numpy as np
import pinocchio as pin

from dvrk_gravity import gravity
from dvrk_gravity.arms import GRAVITY, PER_LINK, Arm, Tree, nominal_inertias, rigid_body
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects.base.site import Kind, joints_with_weight, links_of_joints, unit_travel
from dvrk_gravity.effects.base.term import Evaluator
from dvrk_gravity.parameters import Parameter, Value

AXES = ("x", "y", "z")
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
    show, the prior of independent link parameters of the plausible sizes above: what the
    data leave open stays near "no mass" and in proportion to those sizes. The number b comes
    from a rank-revealing QR with column pivoting (Gautier 1991) of the regressor at random motion.

    Args:
        arm: The arm.
        absent: Link parameters that are zero.
    """
    scale = prior_scale(arm)
    scale[list(absent)] = 0.0
    return _identifiable_combinations(rigid_body.regressor(arm, *samples(arm), arm.gravity), scale)


@lru_cache(maxsize=8)
def weight_directions(arm: Arm) -> Array:
    """Return (4 bodies, b): as :func:`base_directions`, of masses and first moments at rest."""
    scale = prior_scale(arm).reshape(len(arm.bodies), -1)[:, : rigid_body.OF_WEIGHT].ravel()
    return _identifiable_combinations(
        rigid_body.weight_regressor(arm, samples(arm)[0], arm.gravity), scale
    )


def _identifiable_combinations(regressor: Array, scale: Array) -> Array:
    """Return (p, b) combinations, of unit prior size, of the parameters that a regressor shows."""
    from scipy.linalg import qr

    full = regressor.reshape(-1, len(scale)) * scale
    diagonal = np.abs(np.diag(qr(full, mode="r", pivoting=True)[0]))
    rank = int(np.sum(diagonal > _RANK * diagonal[0]))
    directions = np.linalg.svd(full, full_matrices=False)[2][:rank].T
    return scale[:, None] * directions


@lru_cache(maxsize=8)
def separable_rotors(arm: Arm) -> tuple[int, ...]:
    """Return the motors whose rotors' torque is none that links could have.

    The others' inertia is a part of a link's, as far as torque can show.
    """
    q, qd, qdd = samples(arm)
    links = rigid_body.regressor(arm, q, qd, qdd, arm.gravity) @ base_directions(arm)
    basis = np.linalg.qr(links.reshape(-1, links.shape[-1]))[0]
    found = []
    for motor, row in enumerate(arm.joint_to_actuator):
        torque = np.outer(qdd @ row, row).ravel()
        unexplained = torque - basis @ (basis.T @ torque)
        if np.linalg.norm(unexplained) > _RANK * np.linalg.norm(torque):
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


@lru_cache(maxsize=8)
def identifiable_links(arm: Arm) -> tuple[int, ...]:
    """Return the bodies whose weight can be estimated, of those whose weights look equal only one.

    A joint's own link goes before those that follow it: of a parallelogram's sides that turn
    equally about parallel axes, torque shows the mass and how it turns, not on which side it is.
    """
    own_links = [links_of_joints(arm)[joint] for joint in joints_with_weight(arm)]
    following_links = [body for body in range(len(arm.bodies)) if body not in links_of_joints(arm)]
    q, qd, qdd = samples(arm)
    whole = rigid_body.regressor(arm, q, qd, qdd, arm.gravity).reshape(
        -1, len(arm.bodies), PER_LINK
    )
    found: list[int] = []
    spans: list[Array] = []
    for body in (*own_links, *following_links):
        columns, size, _ = np.linalg.svd(whole[:, body], full_matrices=False)
        span = columns[:, size > _RANK * size[0]]
        equivalent = any(
            span.shape == known.shape
            and np.linalg.norm(span - known @ (known.T @ span)) < np.sqrt(_RANK)
            for known in spans
        )
        if body in own_links or not equivalent:
            found.append(body)
            spans.append(span)
    return tuple(found)


def mass_directions(arm: Arm, body: int, com: Array) -> Array:
    """Return (10, 4) inertial parameters per kg and per kg·m of a point mass on a link.

    They are quadratic in where the mass is, hence linearised there.

    Args:
        arm: The arm.
        body: Index of the link.
        com: (3,) its centre in the link's frame, m.
    """
    frame = arm.bodies[body].frame

    def parameters(where: Array) -> Array:
        point = pin.Inertia(1.0, where, np.zeros((3, 3)))
        return np.asarray(frame.act(point).toDynamicParameters())

    # A central difference of a quadratic is exact.
    slopes = [0.5 * (parameters(com + axis) - parameters(com - axis)) for axis in np.eye(3)]
    base = parameters(com) - np.array(slopes).T @ com
    return np.column_stack([base, *slopes])


def place_terms(place: Array) -> Array:
    """Return (S, 10) products of (S, 3) places: 1, x, y, z, xx, yy, zz, xy, xz, yz."""
    x, y, z = place.T
    return np.stack([np.ones(len(place)), x, y, z, x * x, y * y, z * z, x * y, x * z, y * z], 1)


def point_mass_directions(arm: Arm, body: int) -> Array:
    """Return (10, 10) inertial parameters per kg of a point mass, by :func:`place_terms`.

    Args:
        arm: The arm.
        body: Index of the link, in whose frame the place is.
    """
    # Of ten places that determine a quadratic.
    axes = np.eye(3)
    places = np.vstack([np.zeros(3), axes, -axes, axes[[0, 0, 1]] + axes[[1, 2, 2]]])
    frame = arm.bodies[body].frame
    points = [frame.act(pin.Inertia(1.0, place, np.zeros((3, 3)))) for place in places]
    parameters = np.array([point.toDynamicParameters() for point in points])
    return np.asarray(np.linalg.solve(place_terms(places), parameters).T)


# Rotor inertia, as a fraction of a motor's largest effort per rad/s^2: 0.0004 to 0.0023 for the
# MTM's in config/plants.
_ROTOR = 0.002


def assumed_inertias(arm: Arm) -> dict[str, pin.Inertia]:
    """Return inertias of an arm's bodies in their link frames, to simulate it unmeasured.

    The nominal ones of its file (a URDF), or spheres about the links' origins of the sizes of
    :func:`link_sizes`.
    """
    return nominal_inertias(arm) or {
        name: pin.Inertia.FromSphere(mass, extent)
        for name, (mass, extent) in zip(arm.body_names, link_sizes(arm), strict=True)
    }


def assumed_rotors(arm: Arm) -> Array:
    """Return (n,) reflected inertia of rotors, kg·m^2 (kg), to simulate an arm unmeasured."""
    return _ROTOR * arm.actuator_effort_limit / unit_travel(arm, Kind.MOTOR)


def weight_evaluator(tree: Tree) -> Evaluator:
    """Return the evaluator of the torques that hold a tree up."""
    model, data, expand = tree.model, tree.data, tree.expand

    def evaluate(q: Array, qd: Array | None) -> Array:
        return pin.computeGeneralizedGravity(model, data, expand.dot(q)).dot(expand)

    return evaluate


def gravity_parameters() -> tuple[Parameter, ...]:
    """Declare the gravity flag and the direction of gravity."""
    return (
        Parameter(
            "gravity_enabled", True, "", "gravity flag: false leaves the gravity term out",
            adjustable=True,
        ),
        Parameter(
            "gravity_vector", (0.0, 0.0, -GRAVITY), "m/s^2", "gravity in the arm's base frame",
            lower=-30.0, upper=30.0, lengths=(3,), adjustable=True,
        ),
    )  # fmt: skip


def gravity_of(arm: Arm, values: Mapping[str, Value]) -> tuple[Array, bool]:
    """Return (3,) gravity in the base frame, m/s^2, and the gravity flag of a model."""
    vector = values.get("gravity_vector")
    enabled = bool(values.get("gravity_enabled", True))
    return arm.gravity if vector is None else np.array(vector), enabled
