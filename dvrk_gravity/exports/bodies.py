"""Rigid bodies that can exist and have a model's torque, or the nearest that bodies can have.

A model's weight and inertia are known as far as torque shows them, and the parameters that it
carries need be no body's: of an arm that was identified they are the smallest ones. A simulator
takes bodies with positive density: every pseudo-inertia P positive definite (Wensing, Kim,
Slotine 2018). A path of bodies leads from plausible ones P0 to the model's torque: at each weight
of that torque they are the nearest by the log-determinant divergence tr(P0^-1 P) - log det P (Lee,
Wensing, Park 2020), which is convex. It ends at the first from which a least step gives the torque
exactly and leaves bodies. Where no bodies have the torque, it ends (after about a second) at those
that miss the least squares of it, at rest first.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import pinocchio as pin

from dvrk_gravity.arms import PER_LINK, Arm, rigid_body
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects import State, link_sizes, prior_scale
from dvrk_gravity.identification import pseudo_inertia
from dvrk_gravity.simulate import PlantFile

Torque = Callable[[State], Array]
"""(…, n) torques at a state with true positions, N·m or N."""

_STATES = 60  # at rest, and as many in motion: 840 torques of an MTM for 90 parameters
_FASTEST = 2.0  # rad/s and rad/s^2 (``Arm.scale``), by which weight and inertia are of one size
_REST = 10.0  # weight of a pose: what holds an arm up must be right first. Chosen
# Weights of the torques, in squares of a part of a joint's RMS torque. By the last, the divergence
# moves torque by less than 1e-4 of it.
_WEIGHTS = 4.0 ** np.arange(-7, 15)
_SOUND = 1e-9  # least eigenvalue over greatest of a body that a simulator can move
# Of plausible mass and second moments, that a body has at least: what is thinner moves a simulator
# as nothing real does. `identify --physical` has 4e-4.
_LEAST = 1e-4
_STEPS = 40  # of Newton's method for each; ten are usual
_DONE = 1e-4  # half the squared decrement at which it ends, and the weight goes on
_OF_WAY = 0.5  # to where a body is none, that a step goes at most
_ROUNDING = 1e-13  # of an eigenvalue, or of a step
_SAME = 1e-11  # of a joint's RMS torque: rounding
_THIN = 1e-12  # least eigenvalue over greatest that rounding leaves of a point mass
_SOLID = 1e-6  # the same of a body that can stand for a plausible one
_BASIS = np.array([pseudo_inertia(unit) for unit in np.eye(PER_LINK)])


def physical_bodies(arm: Arm, rigid: Torque, known: Array, gravity: Array, moves: bool) -> Array:
    """Return (bodies, 10) inertial parameters of bodies that can exist, in their joint frames.

    Args:
        arm: The arm.
        rigid: The torque that they are to have.
        known: (bodies, 10) parameters that are taken unchanged if they are bodies with that torque.
        gravity: (3,) in the base frame, m/s^2.
        moves: Whether the torque has the bodies' inertia; else what that is, is as plausible.
    """
    rows, right = _equations(arm, rigid, gravity, moves)
    missed = np.abs(rows @ known.ravel() - right).max()
    if missed <= _SAME * _REST and _can_exist(arm, known, -_THIN):
        return known
    # The same squares from fewer rows.
    triangle = np.asarray(np.linalg.qr(np.column_stack([rows, right]), mode="r"))
    rows, right = triangle[:, :-1], triangle[:, -1]
    scale = prior_scale(arm)
    for found in _path(_plausible(arm, known), rows, right):
        residual = right - rows @ found.ravel()
        step = scale * np.linalg.lstsq(rows * scale, residual, rcond=1e-10)[0]
        exact = found + step.reshape(found.shape)
        if _can_exist(arm, exact, _SOUND):
            return exact
    return found


def _can_exist(arm: Arm, links: Array, least: float) -> bool:
    """Return whether all of (bodies, 10) parameters are a body's; see :func:`_is_body`."""
    sizes = (size for _, size in link_sizes(arm))
    return all(_is_body(row, size, least) for row, size in zip(links, sizes, strict=True))


def _is_body(row: Array, size: float, least: float) -> bool:
    """Return whether no eigenvalue of a pseudo-inertia is below ``least`` of the greatest.

    With some rounding, also a point's and nothing's are. Lengths are in units of the link.
    """
    unit = np.array([1.0, 1.0, 1.0, size])
    values = np.linalg.eigvalsh(pseudo_inertia(row) * np.outer(unit, unit))
    return bool(values[0] >= least * values[-1] and (least < 0.0 or values[-1] > 0.0))


def _equations(arm: Arm, rigid: Torque, gravity: Array, moves: bool) -> tuple[Array, Array]:
    """Return (r, 10 bodies) rows and (r,) torques, in parts of each joint's RMS torque."""
    random = np.random.default_rng(0)
    q = random.uniform(*arm.range, (_STATES, arm.n))
    states = [State(q, 0.0 * q, 0.0 * q)]
    if moves:
        motion = _FASTEST * arm.scale * random.uniform(-1.0, 1.0, (2, *q.shape))
        states.append(State(random.uniform(*arm.range, q.shape), *motion))
    rows, right = [], []
    for state, weight in zip(states, (_REST, 1.0), strict=False):
        columns = rigid_body.regressor(arm, state.q, state.qd, state.qdd, gravity)
        rows.append(weight * columns)
        right.append(weight * rigid(state))
    size = np.sqrt(np.mean(right[-1] ** 2, axis=0))
    size = np.maximum(size, 1e-6 * size.max(initial=1e-9))
    return (
        np.concatenate([part / size[:, None] for part in rows]).reshape(-1, rows[0].shape[-1]),
        np.concatenate([part / size for part in right]).ravel(),
    )


def _path(plausible: Array, rows: Array, right: Array) -> Iterator[Array]:
    """Yield (bodies, 10) that minimise weight |rows x - right|^2 / 2 + divergence, by weights.

    By small steps of the weight, from plausible bodies: Newton's method stays near the path, where
    by large ones it would run into bodies that cannot exist (Nesterov, Nemirovskii 1994).
    """
    found = plausible
    # X = L^-1 P L^-T, of plausible ones P0 = L L' one.
    whiten = np.linalg.inv(np.linalg.cholesky(np.einsum("bk,kij->bij", found, _BASIS)))
    basis = np.einsum("bij,kjl,bml->bkim", whiten, _BASIS, whiten)
    least = _LEAST * np.eye(4)

    def matrices(links: Array) -> Array:
        return np.einsum("bk,bkij->bij", links, basis) - least

    def value(links: Array, weight: float) -> float:
        eigenvalues = np.linalg.eigvalsh(matrices(links))
        if (eigenvalues[:, 0] <= _ROUNDING * eigenvalues[:, -1]).any():
            return np.inf
        missed = rows @ links.ravel() - right
        divergence = np.sum(eigenvalues - np.log(eigenvalues))
        return float(0.5 * weight * missed @ missed + divergence)

    for weight in _WEIGHTS.tolist():
        for _ in range(_STEPS):
            inverse = np.linalg.inv(matrices(found))
            gradient = np.einsum("bkij,bij->bk", basis, np.eye(4) - inverse)
            carried = np.einsum("bij,bkjl->bkil", inverse, basis)
            try:
                curvature = np.linalg.cholesky(np.einsum("bkil,bmli->bkm", carried, carried))
            except np.linalg.LinAlgError:  # rounding, at the very edge of what can exist
                break
            # Newton's step by least squares, in units in which the divergence's curvature is one.
            unit = np.linalg.inv(curvature)
            seen = np.einsum("rbk,bmk->rbm", rows.reshape(-1, *found.shape), unit)
            stacked = np.vstack([np.sqrt(weight) * seen.reshape(len(rows), -1), np.eye(found.size)])
            missed = np.sqrt(weight) * (right - rows @ found.ravel())
            pull = -np.einsum("bmk,bk->bm", unit, gradient).ravel()
            solved = np.linalg.lstsq(stacked, np.concatenate([missed, pull]))[0]
            if np.sum((stacked @ solved) ** 2) <= 2.0 * _DONE:
                break
            step = np.einsum("bmk,bm->bk", unit, solved.reshape(found.shape))
            now, way = value(found, weight), step
            turned = np.linalg.solve(matrices(found), matrices(found + way)) - np.eye(4)
            least_ratio = float(np.linalg.eigvals(turned).real.min())
            length = min(1.0, _OF_WAY / max(-least_ratio, _ROUNDING))
            while length > _ROUNDING and not value(found + length * way, weight) < now:
                length *= 0.5
            if length <= _ROUNDING:
                break
            found = found + length * way
        yield found


def _plausible(arm: Arm, known: Array) -> Array:
    """Return (bodies, 10): known ones that are bodies, else the arm's plant's, else spheres."""
    links = PlantFile.of(arm).links
    found = []
    for body, row, (mass, size) in zip(arm.bodies, known, link_sizes(arm), strict=True):
        inertia = links.get(body.name, pin.Inertia.Zero())
        of_plant = body.frame.act(inertia).toDynamicParameters()
        sphere = body.frame.act(pin.Inertia.FromSphere(mass, size)).toDynamicParameters()
        found.append(next(each for each in (row, of_plant, sphere) if _is_body(each, size, _SOLID)))
    return np.array(found)
