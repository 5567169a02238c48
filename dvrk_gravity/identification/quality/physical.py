"""Link parameters that a body can have: every pseudo-inertia positive definite.

A link's ten parameters belong to a body with positive density exactly if the 4 x 4
matrix [[Sigma, m c], [m c', m]], Sigma its second moments, is positive definite
(Wensing, Kim, Slotine 2018). Written as L L' with a positive diagonal of L it always
is; L is then searched by least squares, together with the coefficients that stay linear.
`identify --physical` asks for such bodies; the simulator, which cannot move others, completes the
inertia of every model to the nearest of them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dvrk_gravity.arms import Arm, rigid_body
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects import link_sizes, prior_scale
from dvrk_gravity.estimation import Solution
from dvrk_gravity.model import Columns, link_columns

_ROWS, _COLUMNS = np.tril_indices(4)
_DIAGONAL = _ROWS == _COLUMNS


# Least entry of L's diagonal over its plausible value. Chosen: a mass, or a second moment, of 4e-4
# of what is plausible is none, and L stays regular.
_LEAST = 0.02


def physical_links(
    columns: Columns, chosen: Sequence[int], solution: Solution
) -> tuple[Array, Array]:
    """Return the best coefficients whose links are physically consistent.

    Args:
        columns: The columns.
        chosen: Columns of the fit, the rigid-body ones first.
        solution: The unconstrained fit.

    Returns:
        (p,) coefficients and (10 bodies,) link parameters that belong to them.
    """
    index = list(chosen)
    bodies = len(link_columns(columns))
    scale = prior_scale(columns.arm)
    # (b, 10 bodies): the links' part in the base parameters; see base_directions.
    seen = columns.base.T / scale**2
    others = np.arange(bodies, len(index))
    # |factor (theta - best)|^2 is the misfit of a theta.
    prior = solution.precision - solution.data
    prior[:bodies, :bodies] = 0.0
    hessian = solution.data + prior
    hessian[np.diag_indices_from(hessian)] += 1e-9 * np.diag(hessian).max()
    factor = np.linalg.cholesky(hessian).T
    best = np.linalg.solve(hessian, solution.precision @ solution.theta)
    size = columns.scale[index][others]
    positive = columns.positive[index][others] | ~solution.free[others]
    links, found = nearest_bodies(
        columns.arm,
        factor[:, :bodies] @ seen, factor[:, bodies:] * size, factor @ best,
        np.zeros(len(scale)), 1.0 / scale,
        solution.theta[others] / size, np.where(positive, 0.0, -np.inf),
    )  # fmt: skip
    return np.concatenate([seen @ links, found * size]), links


def nearest_bodies(
    arm: Arm,
    of_links: Array, of_others: Array, right: Array, middle: Array, hold: Array, first: Array,
    least: Array, evaluations: int = 300,
) -> tuple[Array, Array]:  # fmt: skip
    """Return the bodies and other coefficients that solve linear equations best.

    Minimises |of_links links + of_others others - right|^2 + |hold (links - middle)|^2.

    Args:
        arm: The arm.
        of_links: (r, 10 bodies) coefficients of the links.
        of_others: (r, p) of the other unknowns, of order one each.
        right: (r,) right-hand side.
        middle: (10 bodies,) link parameters preferred where the equations leave them open.
        hold: (10 bodies,) weight of that preference.
        first: (p,) initial other unknowns.
        least: (p,) their lower bounds.
        evaluations: Of the equations, at most.

    Returns:
        (10 bodies,) link parameters and (p,) other coefficients.
    """
    from scipy.optimize import least_squares

    start, lower = _start(arm)
    bodies = len(start)
    still = np.zeros((bodies, len(first)))

    def residual(unknown: Array) -> Array:
        links = _links(unknown[:bodies])
        missed = of_links @ links + of_others @ unknown[bodies:] - right
        return np.concatenate([missed, hold * (links - middle)])

    def jacobian(unknown: Array) -> Array:
        slope = _slope(unknown[:bodies])
        return np.block([[of_links @ slope, of_others], [hold[:, None] * slope, still]])

    bounds = np.concatenate([lower, least])
    begin = np.concatenate([start, np.maximum(first, least)])
    found = least_squares(
        residual, np.maximum(begin, bounds + 1e-12), jacobian, (bounds, np.inf), x_scale="jac",
        max_nfev=evaluations,
    )  # fmt: skip
    return _links(found.x[:bodies]), found.x[bodies:]


def certificate(arm: Arm, links: Array) -> dict[str, float]:
    """Return each link's least eigenvalue of the pseudo-inertia over its greatest.

    Args:
        arm: The arm.
        links: (10 bodies,) parameters in the order of its bodies.
    """
    result = {}
    rows = links.reshape(-1, rigid_body.PER_LINK)
    for body, row, (_, extent) in zip(arm.body_names, rows, link_sizes(arm), strict=True):
        # Lengths in units of the link, so that the number does not depend on metres.
        unit = np.array([1.0, 1.0, 1.0, extent])
        values = np.linalg.eigvalsh(pseudo_inertia(row) * np.outer(unit, unit))
        result[body] = float(values[0] / values[-1])
    return result


def pseudo_inertia(row: Array) -> Array:
    """Return (4, 4) from (10,) parameters in Pinocchio's order."""
    m, cx, cy, cz, xx, xy, yy, xz, yz, zz = row
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    first = np.array([cx, cy, cz])
    second = 0.5 * np.trace(inertia) * np.eye(3) - inertia
    return np.block([[second, first[:, None]], [first[None], np.array([[m]])]])


def _parameters() -> Array:
    """Return (10, 4, 4): each parameter as a linear function of the pseudo-inertia."""
    maps = np.zeros((10, 4, 4))
    maps[0, 3, 3] = 1.0
    for k in range(3):
        maps[1 + k, k, 3] = 1.0
    for index, (i, j) in zip((4, 5, 6, 7, 8, 9), ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2)),
                             strict=True):  # fmt: skip
        maps[index, i, j] = -1.0
        if i == j:
            maps[index, :3, :3] += np.eye(3)
    return 0.5 * (maps + maps.transpose(0, 2, 1))


_MAPS = _parameters()


def _start(arm: Arm) -> tuple[Array, Array]:
    """Return (10 bodies,) entries of L of plausible links, and their lower bounds."""
    start, lower = [], []
    for mass, size in link_sizes(arm):
        entries = np.where(_DIAGONAL, np.sqrt(mass) * np.where(_ROWS == 3, 1.0, size / 3.0), 0.0)
        start.append(entries)
        lower.append(np.where(_DIAGONAL, _LEAST * entries, -np.inf))
    return np.concatenate(start), np.concatenate(lower)


def _lower_triangles(entries: Array) -> Array:
    rows = entries.reshape(-1, len(_ROWS))
    triangles = np.zeros((len(rows), 4, 4))
    triangles[:, _ROWS, _COLUMNS] = rows
    return triangles


def _links(entries: Array) -> Array:
    """Return (10 bodies,) parameters of L L'."""
    triangles = _lower_triangles(entries)
    return np.einsum("pij,bik,bjk->bp", _MAPS, triangles, triangles).ravel()


def _slope(entries: Array) -> Array:
    """Return (10 bodies, 10 bodies) derivatives of the parameters by the entries of L."""
    triangles = _lower_triangles(entries)
    # d tr(A L L') / dL = 2 A L for symmetric A.
    slopes = 2.0 * np.einsum("pij,bjk->bpik", _MAPS, triangles)[:, :, _ROWS, _COLUMNS]
    size = len(triangles) * rigid_body.PER_LINK
    full = np.zeros((size, size))
    for b, block in enumerate(slopes):
        rows = slice(rigid_body.PER_LINK * b, rigid_body.PER_LINK * (b + 1))
        full[rows, rows] = block
    return full
