"""Rigid bodies that can exist and have a model's torque, or the nearest that bodies can have.

A model's weight and inertia are known as far as torque shows them, and the parameters that it
carries need be no body's: of an arm that was identified they are the smallest ones. What a simulator
takes are bodies with positive density: every pseudo-inertia P positive definite (Wensing, Kim,
Slotine 2018). Of all bodies with the model's torque these are the nearest to plausible ones P0 by
the log-determinant divergence tr(P0^-1 P) - log det P (Lee, Wensing, Park 2020), which is convex:
Newton's method ends in tens of milliseconds. Where no bodies have the torque, the squares of what
they miss are least, those at rest first.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from dvrk_gravity.arms import PER_LINK, Arm, rigid_body
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects import State, Term, link_sizes, prior_scale
from dvrk_gravity.identification import certificate, pseudo_inertia
from dvrk_gravity.simulate import PlantFile

_STATES = 60  # at rest, and as many in motion: 840 torques of an MTM for 90 parameters
_FASTEST = 2.0  # rad/s and rad/s^2 (``Arm.scale``), by which weight and inertia count alike
_REST = 10.0  # weight of a pose: what holds an arm up must be right first. Chosen
# Weights of the torques, in squares of a part of a joint's RMS torque: by the last the divergence
# of ten bodies moves torque by 1e-5 of it, which the exact step below takes off.
_WEIGHTS = 10.0 ** np.arange(0, 7, 2)
# Of plausible mass and second moments, that a body has at least: what is thinner moves a simulator
# as nothing real does. `identify --physical` has 4e-4.
_LEAST = 1e-4
_STEPS = 40  # of Newton's method for each; ten are usual
_DONE = 1e-8  # half the squared decrement at which it ends
_ROUNDING = 1e-13  # of an eigenvalue, or of a step
_SAME = 1e-11  # of a joint's RMS torque: rounding
_THIN = 1e-12  # least eigenvalue over greatest that rounding leaves of a point mass
_SOLID = 1e-6  # the same of a body that can stand for a plausible one
_BASIS = np.array([pseudo_inertia(unit) for unit in np.eye(PER_LINK)])


def physical_bodies(
    arm: Arm, rigid: Sequence[Term], known: Array, gravity: Array, moves: bool
) -> Array:
    """Return (bodies, 10) inertial parameters of bodies that can exist, in their joint frames.

    Args:
        arm: The arm.
        rigid: The terms whose torque they are to have.
        known: (bodies, 10) parameters that are taken unchanged if they are bodies with that torque.
        gravity: (3,) in the base frame, m/s^2.
        moves: Whether the torque has the bodies' inertia; else what that is, is as plausible.
    """
    rows, right = _equations(arm, rigid, gravity, moves)
    missed = np.abs(rows @ known.ravel() - right).max()
    if missed <= _SAME * _REST and min(certificate(arm, known.ravel()).values()) >= -_THIN:
        return known
    # The same squares from fewer rows.
    triangle = np.linalg.qr(np.column_stack([rows, right]), mode="r")
    rows, right = triangle[:, :-1], triangle[:, -1]
    found = _nearest(arm, rows, right)
    scale = prior_scale(arm)
    step = scale * np.linalg.lstsq(rows * scale, right - rows @ found, rcond=1e-10)[0]
    exact = found + step
    if min(certificate(arm, exact).values()) > 0.0:
        found = exact
    return found.reshape(-1, PER_LINK)


def _equations(
    arm: Arm, rigid: Sequence[Term], gravity: Array, moves: bool
) -> tuple[Array, Array]:
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
        torque = np.sum([term.torque(state) for term in rigid], axis=0) + np.zeros(q.shape)
        rows.append(weight * columns)
        right.append(weight * torque)
    size = np.sqrt(np.mean(right[-1] ** 2, axis=0))
    size = np.maximum(size, 1e-6 * size.max(initial=1e-9))
    return (
        np.concatenate([part / size[:, None] for part in rows]).reshape(-1, rows[0].shape[-1]),
        np.concatenate([part / size for part in right]).ravel(),
    )


def _nearest(arm: Arm, rows: Array, right: Array) -> Array:
    """Return (10 bodies,) parameters that minimise weight |rows x - right|^2 / 2 + divergence."""
    found = _plausible(arm)
    # X = L^-1 P L^-T, of plausible bodies P0 = L L' one.
    whiten = np.linalg.inv(np.linalg.cholesky(np.einsum("bk,kij->bij", found, _BASIS)))
    basis = np.einsum("bij,kjl,bml->bkim", whiten, _BASIS, whiten)
    least = _LEAST * np.eye(4)
    square, slope = rows.T @ rows, rows.T @ right

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
            gradient = np.einsum("bkij,bij->bk", basis, np.eye(4) - inverse).ravel()
            gradient += weight * (square @ found.ravel() - slope)
            hessian = weight * square
            carried = np.einsum("bij,bkjl->bkil", inverse, basis)
            for body, block in enumerate(np.einsum("bkil,bmli->bkm", carried, carried)):
                part = slice(PER_LINK * body, PER_LINK * (body + 1))
                hessian[part, part] += block
            # In units of each parameter's own curvature.
            unit = 1.0 / np.sqrt(np.diag(hessian))
            step = unit * np.linalg.lstsq(hessian * np.outer(unit, unit), -unit * gradient)[0]
            if -gradient @ step <= 2.0 * _DONE:
                break
            now, length, way = value(found, weight), 1.0, step.reshape(found.shape)
            while length > _ROUNDING and not value(found + length * way, weight) < now:
                length *= 0.5
            if length <= _ROUNDING:
                break
            found = found + length * way
    return found.ravel()


def _plausible(arm: Arm) -> Array:
    """Return (bodies, 10) of the arm's plant; spheres for those that are none's."""
    links = PlantFile.of(arm).links
    found = []
    for body, (mass, size) in zip(arm.bodies, link_sizes(arm), strict=True):
        sphere = body.frame.act(pin.Inertia.FromSphere(mass, size)).toDynamicParameters()
        if (inertia := links.get(body.name)) is None:
            found.append(sphere)
            continue
        row = body.frame.act(inertia).toDynamicParameters()
        unit = np.array([1.0, 1.0, 1.0, size])
        values = np.linalg.eigvalsh(pseudo_inertia(row) * np.outer(unit, unit))
        found.append(row if values[0] > _SOLID * values[-1] else sphere)
    return np.array(found)

