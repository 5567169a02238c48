"""Link parameters that a body can have: every pseudo-inertia positive definite.

A link's ten parameters belong to a body with positive density exactly if the 4 x 4
matrix [[Sigma, m c], [m c', m]], Sigma its second moments, is positive definite
(Wensing, Kim, Slotine 2018). Written as L L' with a positive diagonal of L it always
is; L is then searched by least squares, together with the coefficients that stay linear.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dvrk_gravity.identification.columns import SIZES, Columns, prior_scale
from dvrk_gravity.identification.regression import Solution
from dvrk_gravity.recording.data import Array
from dvrk_gravity.terms import rigid_body
from dvrk_gravity.tree import TREE_LINKS

_ROWS, _COLUMNS = np.tril_indices(4)
_DIAGONAL = _ROWS == _COLUMNS
LEAST = 0.02  # of its plausible value, to which an entry of L's diagonal may fall


def physical_links(
    columns: Columns, chosen: Sequence[int], solution: Solution
) -> tuple[Array, Array]:
    """Return the best coefficients whose links are bodies that can exist.

    Args:
        columns: The columns.
        chosen: Columns of the fit, the rigid-body ones first.
        solution: The unconstrained fit.

    Returns:
        (p,) coefficients and (90,) link parameters that belong to them.
    """
    from scipy.optimize import least_squares

    index = list(chosen)
    bodies = len(columns.select(effect="link_inertia"))
    scale = prior_scale()
    # (b, 90): what torque sees of the links; see base_directions.
    seen = columns.base.T / scale**2
    others = np.arange(bodies, len(index))
    start, lower = _start()
    # |factor (theta - best)|^2 is what the data have against a theta.
    prior = solution.precision - solution.data
    prior[:bodies, :bodies] = 0.0
    hessian = solution.data + prior
    hessian[np.diag_indices_from(hessian)] += 1e-9 * np.diag(hessian).max()
    factor = np.linalg.cholesky(hessian).T
    right = solution.precision @ solution.theta
    best = np.linalg.solve(hessian, right)
    size = columns.scale[index][others]
    free = solution.free[others]

    def split(unknown: Array) -> tuple[Array, Array]:
        links = _links(unknown[: len(start)])
        return np.concatenate([seen @ links, unknown[len(start) :] * size]), links

    def residual(unknown: Array) -> Array:
        theta, links = split(unknown)
        return np.concatenate([factor @ (theta - best), links / scale])

    def jacobian(unknown: Array) -> Array:
        slope = _slope(unknown[: len(start)])
        top = np.hstack([factor[:, :bodies] @ seen @ slope, factor[:, bodies:] * size])
        bottom = np.hstack([slope / scale[:, None], np.zeros((len(scale), len(others)))])
        return np.vstack([top, bottom])

    positive = columns.positive[index][others] | ~free
    bounds = np.concatenate([lower, np.where(positive, 0.0, -np.inf)])
    first = np.concatenate([start, np.maximum(solution.theta[others] / size, bounds[len(start) :])])
    found = least_squares(
        residual, np.maximum(first, bounds + 1e-12), jacobian, (bounds, np.inf), x_scale="jac",
        max_nfev=300,
    )  # fmt: skip
    theta, links = split(found.x)
    return theta, links


def certificate(links: Array) -> dict[str, float]:
    """Return each link's least eigenvalue of the pseudo-inertia over its greatest.

    Args:
        links: (90,) parameters in the order of ``TREE_LINKS``.
    """
    result = {}
    for body, row in zip(TREE_LINKS, links.reshape(-1, rigid_body.PER_LINK), strict=True):
        # Lengths in units of the link, so that the number does not depend on metres.
        unit = np.array([1.0, 1.0, 1.0, SIZES[body][1]])
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
    for place, (i, j) in zip((4, 5, 6, 7, 8, 9), ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2)),
                             strict=True):  # fmt: skip
        maps[place, i, j] = -1.0
        if i == j:
            maps[place, :3, :3] += np.eye(3)
    return 0.5 * (maps + maps.transpose(0, 2, 1))


_MAPS = _parameters()


def _start() -> tuple[Array, Array]:
    """Return (90,) entries of L of plausible links, and their lower bounds."""
    start, lower = [], []
    for mass, size in (SIZES[body] for body in TREE_LINKS):
        entries = np.where(_DIAGONAL, np.sqrt(mass) * np.where(_ROWS == 3, 1.0, size / 3.0), 0.0)
        start.append(entries)
        lower.append(np.where(_DIAGONAL, LEAST * entries, -np.inf))
    return np.concatenate(start), np.concatenate(lower)


def _lower_triangles(entries: Array) -> Array:
    triangles = np.zeros((len(TREE_LINKS), 4, 4))
    triangles[:, _ROWS, _COLUMNS] = entries.reshape(len(TREE_LINKS), -1)
    return triangles


def _links(entries: Array) -> Array:
    """Return (90,) parameters of L L'."""
    triangles = _lower_triangles(entries)
    return np.einsum("pij,bik,bjk->bp", _MAPS, triangles, triangles).ravel()


def _slope(entries: Array) -> Array:
    """Return (90, 90) derivatives of the parameters by the entries of L."""
    triangles = _lower_triangles(entries)
    # d tr(A L L') / dL = 2 A L for symmetric A.
    slopes = 2.0 * np.einsum("pij,bjk->bpik", _MAPS, triangles)[:, :, _ROWS, _COLUMNS]
    size = len(TREE_LINKS) * rigid_body.PER_LINK
    full = np.zeros((size, size))
    for b, block in enumerate(slopes):
        rows = slice(rigid_body.PER_LINK * b, rigid_body.PER_LINK * (b + 1))
        full[rows, rows] = block
    return full
