"""Link parameters that a body can have: every pseudo-inertia positive definite.

A link's ten parameters belong to a body with positive density exactly if the 4 x 4
matrix [[Sigma, m c], [m c', m]], Sigma its second moments, is positive definite
(Wensing, Kim, Slotine 2018), a linear matrix inequality. So the bodies closest to a fit, in its own
standard deviations, are a semidefinite program in its parameters, however many samples it has.
Torque depends on combinations of the parameters only: the others are free, and near those of
plausible links. The simulator, which moves bodies only, completes the inertia of every model to
the nearest of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from dvrk_gravity.arms import Arm, rigid_body
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects import base_directions, link_sizes, prior_scale
from dvrk_gravity.estimation import NotConvergedError, Solution
from dvrk_gravity.model import Columns

# Least pseudo-inertia, as a part of a plausible link's. Chosen: with a tenth of it, the bodies are
# .01 standard deviations closer to fits of measured arms.
_LEAST = 1e-4
# Weight of what torque does not show, in units of plausible size, beside the squared distance from
# the fit. Chosen: decides between bodies of the same torque.
_UNSEEN = 1e-6
_PRECISION = 1e-6  # of the program's solution, in standard deviations


def require_solver() -> None:
    """Import the solver: where it is missing, that is said before minutes of work, not after."""
    import clarabel  # noqa: F401


def possible_links(columns: Columns, base: Array) -> Array | None:
    """Return links that bodies can have and of exactly a fit's torque; ``None`` if none are.

    Args:
        columns: The columns.
        base: (b,) coefficients of the links' columns.

    Returns:
        (10 bodies,) link parameters.
    """
    parts = _parts(columns.mounted, columns.ABSENT)
    seen = parts.seen @ base
    unseen = _program(
        np.ones(parts.unseen.shape[1]), parts.plausible - parts.unseen.T @ seen,
        _triangles(parts.unseen), _triangles(seen), np.zeros((0, parts.unseen.shape[1])),
        np.zeros(0),
    )  # fmt: skip
    links = parts.scale * (seen + parts.unseen @ unseen)
    return links if min(certificate(columns.arm, links).values()) > 0.0 else None


def physical_links(
    columns: Columns, chosen: Sequence[int], solution: Solution
) -> tuple[Array, Array]:
    """Return the coefficients nearest to a fit's whose links are bodies.

    Nearest in the fit's standard deviations, (theta - fit)' precision (theta - fit). Coefficients
    that must not be negative stay so; those held at zero stay there.

    Args:
        columns: The columns.
        chosen: Columns of the fit, the rigid-body ones first.
        solution: The unconstrained fit.

    Returns:
        (p,) coefficients and (10 bodies,) link parameters that belong to them.

    Raises:
        NotConvergedError: The solver found none.
    """
    parts, index = _parts(columns.mounted, columns.ABSENT), np.array(chosen)
    base = parts.seen.shape[1]
    signed = np.flatnonzero(columns.positive[index] & solution.free)
    others = np.flatnonzero(~columns.positive[index] & solution.free)[base:]
    order = np.concatenate([np.arange(base), signed, others])
    bound = base + len(signed)
    # theta = fit + spread y, |y| the distance. Lower triangular: the last ones follow the first.
    precision = solution.precision[np.ix_(order, order)]
    factor = np.linalg.cholesky(precision[::-1, ::-1])[::-1, ::-1]
    spread = np.linalg.inv(factor).T[:, :bound]
    seen = parts.seen @ solution.theta[:base]
    size = np.linalg.norm(spread[base:bound], axis=1)
    found = _program(
        np.concatenate([np.ones(bound), np.full(parts.unseen.shape[1], _UNSEEN)]),
        np.concatenate([np.zeros(bound), _UNSEEN * (parts.plausible - parts.unseen.T @ seen)]),
        _triangles(np.hstack([parts.seen @ spread[:base], parts.unseen])), _triangles(seen),
        np.pad(spread[base:bound] / size[:, None], ((0, 0), (0, parts.unseen.shape[1]))),
        solution.theta[signed] / size,
    )  # fmt: skip
    theta = solution.theta.copy()
    theta[order] += spread @ found[:bound]
    theta[signed] = np.maximum(theta[signed], 0.0)
    links = parts.scale * (parts.seen @ theta[:base] + parts.unseen @ found[bound:])
    if not min(certificate(columns.arm, links).values()) > 0.0:
        raise NotConvergedError(
            f"{len(links) // rigid_body.PER_LINK} links: no bodies near the fit were found; "
            "--no-physical fits without them"
        )
    return theta, links


def nearest_bodies(
    arm: Arm, of_links: Array, of_others: Array, right: Array, middle: Array, hold: Array
) -> tuple[Array, Array]:
    """Return the bodies and non-negative coefficients that solve linear equations best.

    Minimises |of_links links + of_others others - right|^2 + |hold (links - middle)|^2.

    Args:
        arm: The arm.
        of_links: (r, 10 bodies) coefficients of the links.
        of_others: (r, p) of the other unknowns, of order one each.
        right: (r,) right-hand side.
        middle: (10 bodies,) link parameters preferred where the equations leave them open.
        hold: (10 bodies,) weight of that preference.

    Returns:
        (10 bodies,) link parameters and (p,) other coefficients.
    """
    scale, (count, more) = prior_scale(arm), (len(middle), of_others.shape[1])
    rows = np.hstack([of_links * scale, of_others])
    held = np.concatenate([hold * scale, np.zeros(more)])
    unit = np.eye(count + more)
    found = _program(
        rows.T @ rows + np.diag(held**2),
        rows.T @ right + held**2 * np.concatenate([middle / scale, np.zeros(more)]),
        _triangles(unit[:count]), _triangles(np.zeros(count)), unit[count:], np.zeros(more),
    )  # fmt: skip
    return scale * found[:count], np.maximum(found[count:], 0.0)


def certificate(arm: Arm, links: Array) -> dict[str, float]:
    """Return each link's least eigenvalue of the pseudo-inertia over its largest one by size.

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
        largest = np.abs(values).max()  # of a negative mass it is not the last
        result[body] = float(values[0] / largest) if largest > 0.0 else 0.0
    return result


def pseudo_inertia(row: Array) -> Array:
    """Return (4, 4) from (10,) parameters in Pinocchio's order."""
    m, cx, cy, cz, xx, xy, yy, xz, yz, zz = row
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    first = np.array([cx, cy, cz])
    second = 0.5 * np.trace(inertia) * np.eye(3) - inertia
    return np.block([[second, first[:, None]], [first[None], np.array([[m]])]])


def _triangle(matrix: Array) -> Array:
    """Return (10,) columns of a (4, 4) upper triangle, of the same norm as the matrix."""
    return np.array([matrix[i, j] * (1.0 if i == j else 2.0**0.5)
                     for j in range(4) for i in range(j + 1)])  # fmt: skip


_TO_TRIANGLE = np.stack([_triangle(pseudo_inertia(unit)) for unit in np.eye(10)], axis=1)
# Of a body of plausible mass, about its frame's origin, a third of its extent in each direction.
_PLAUSIBLE = _triangle(np.diag([1 / 9, 1 / 9, 1 / 9, 1.0]))


@dataclass(frozen=True, eq=False)
class _Parts:
    """Link parameters in units of plausible size: what torque shows of them, and what it does not.

    Attributes:
        scale: (10 bodies,) those units.
        seen: (10 bodies, b) orthonormal, of the base parameters.
        unseen: (10 bodies, u) orthonormal, of the others that are not taken as zero.
        plausible: (u,) plausible links along ``unseen``.
    """

    scale: Array
    seen: Array
    unseen: Array
    plausible: Array


@lru_cache(maxsize=8)
def _parts(arm: Arm, absent: tuple[int, ...]) -> _Parts:
    scale = prior_scale(arm)
    seen = base_directions(arm, absent) / scale[:, None]
    there = np.setdiff1d(np.arange(len(scale)), absent)
    unseen = np.zeros((len(scale), len(there) - seen.shape[1]))
    unseen[there] = np.linalg.svd(seen[there])[0][:, seen.shape[1] :]
    plausible = np.linalg.solve(_TO_TRIANGLE, _PLAUSIBLE)
    return _Parts(scale, seen, unseen, unseen.T @ np.tile(plausible, len(arm.bodies)))


def _triangles(links: Array) -> Array:
    """Return (10 bodies, …) pseudo-inertias' triangles of links in units of plausible size."""
    rows = links.reshape(-1, rigid_body.PER_LINK, *links.shape[1:])
    return np.tensordot(_TO_TRIANGLE, rows, (1, 1)).swapaxes(0, 1).reshape(links.shape)


def _program(
    quadratic: Array,
    linear: Array,
    of_bodies: Array,
    bodies: Array,
    of_signed: Array,
    signed: Array,
) -> Array:
    """Return the (k,) x at which a convex quadratic is least under both kinds of constraint.

    Minimises x' quadratic x / 2 - linear' x, by Clarabel's interior point (Goulart and Chen 2024).

    Args:
        quadratic: (k, k), or the (k,) diagonal.
        linear: (k,).
        of_bodies: (10 bodies, k) and
        bodies: (10 bodies,): triangles of the pseudo-inertias, ``bodies + of_bodies x``.
        of_signed: (s, k) and
        signed: (s,): ``signed + of_signed x`` must not be negative.
    """
    import clarabel  # not needed by those who only evaluate a model
    from scipy.sparse import csc_array

    count = len(bodies) // rigid_body.PER_LINK
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = _PRECISION
    cones = [clarabel.PSDTriangleConeT(4)] * count + [clarabel.NonnegativeConeT(len(signed))]
    whole = np.diag(quadratic) if quadratic.ndim == 1 else np.triu(quadratic)
    solver = clarabel.DefaultSolver(
        csc_array(whole), -linear, csc_array(-np.vstack([of_bodies, of_signed])),
        np.concatenate([bodies - _LEAST * np.tile(_PLAUSIBLE, count), signed]), cones, settings,
    )  # fmt: skip
    return np.array(solver.solve().x)
