"""Where a motion may begin and end: at rest within all limits; or which limit leaves no place."""

from __future__ import annotations

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects import State
from dvrk_gravity.errors import PlanError
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.planning.keeping import box_links, distances, efforts
from dvrk_gravity.planning.plan_limits import PlanLimits

_DRAWS = 4000  # random positions that are looked at


def resting_positions(
    limits: PlanLimits,
    arm: Arm,
    model: TorqueModel | None,
    random: np.random.Generator,
    count: int = 1,
) -> Array:
    """Return (count, n) positions at rest that keep all limits, those with most room among many.

    Args:
        limits: Of positions, of efforts with a model, and boxes.
        arm: The arm.
        model: For the efforts that hold the arm; ``None``: not known.
        random: For the draw.
        count: How many are returned, at most: as many as were found.

    Raises:
        PlanError: There are none: the limit and by how much it would have to give.
    """
    centre = _centre(limits, arm)
    q = _drawn(limits, centre, random)
    room = np.ones(len(q))
    for name, left, unit, size in _others(limits, arm, model, q):
        least = float(left.max())
        if least < 0.0:
            raise PlanError(f"{name} would have to give {-least:.3g} {unit}, at the best position")
        room = np.minimum(room, left / size)
    if room.max() < 0.0:
        at = int(np.argmax(room))
        short = [
            f"{name} {-float(left[at]):.3g} {unit}"
            for name, left, unit, _ in _others(limits, arm, model, q)
            if left[at] < 0.0
        ]
        raise PlanError(f"{' and '.join(short)} would have to give, at the best position")
    order = np.argsort(-room, kind="stable")
    return q[order[: min(count, int(np.sum(room >= 0.0)))]]


def _others(
    limits: PlanLimits, arm: Arm, model: TorqueModel | None, q: Array
) -> list[tuple[str, Array, str, float]]:
    """Return name, (N,) what is left, unit, and size of each limit that is not of positions."""
    found = []
    if model is not None:
        rest = np.zeros_like(q)
        load, _ = efforts(model, State(q, rest, rest))
        for k, name in enumerate(arm.joint_names):
            limit = float(limits.effort[k])
            left = limit - load[:, k]
            found.append((f"the effort limit of {name}'s motor", left, arm.effort_units[k], limit))
    if limits.boxes:
        away = distances(arm, limits.boxes, q)
        for k, name in enumerate(box_links(limits.boxes)):
            found.append((f"the distance of {name}", away[:, k], "m", 0.1))
    return found


def _centre(limits: PlanLimits, arm: Arm) -> Array:
    """Return the (n,) position with most room between the limits of positions.

    Raises:
        PlanError: There is no such position.
    """
    from scipy.optimize import linprog

    lower, upper = limits.range
    scale = np.abs(limits.rows) @ arm.scale
    for k, name in enumerate(limits.names):
        if lower[k] > upper[k]:
            raise PlanError(
                f"position limits of {name} would have to give {lower[k] - upper[k]:.3g} "
                f"{_unit(limits, arm, k)}: the lower one is above the upper one"
            )
    sides = np.vstack([limits.rows, -limits.rows])
    bound = np.concatenate([upper, -lower])
    finite = np.isfinite(bound)
    # Greatest room, as a part of a rad or of 0.1 m.
    found = linprog(
        np.append(np.zeros(arm.n), -1.0),
        A_ub=np.hstack([sides, np.tile(scale, 2)[:, None]])[finite],
        b_ub=bound[finite],
        bounds=[(None, None)] * arm.n + [(None, 10.0)],
    )
    q, room = found.x[:-1], float(found.x[-1])
    if room >= 0.0:
        return np.asarray(q)
    # The least by which combinations would have to give, with the joints' own limits kept.
    own, count = arm.n, len(limits.combinations)
    rows = limits.rows[own:]
    give = np.vstack([np.hstack([rows, -np.eye(count)]), np.hstack([-rows, -np.eye(count)])])
    bound = np.concatenate([upper[own:], -lower[own:]])
    finite = np.isfinite(bound)
    found = linprog(
        np.append(np.zeros(own), np.ones(count)), A_ub=give[finite], b_ub=bound[finite],
        bounds=[*zip(lower[:own], upper[:own], strict=True), *[(0.0, None)] * count],
    )  # fmt: skip
    short = [
        f"{each.name} {gives:.3g} {_unit(limits, arm, own + k)}"
        for k, (each, gives) in enumerate(
            zip(limits.combinations, found.x[own:].tolist(), strict=True)
        )
        if gives > 1e-9
    ]
    raise PlanError(
        f"position limits of {' and '.join(short)} would have to give: the joints' own limits "
        "leave no such position"
    )


def _unit(limits: PlanLimits, arm: Arm, row: int) -> str:
    return arm.units[int(np.flatnonzero(limits.rows[row])[0])]


def _drawn(limits: PlanLimits, centre: Array, random: np.random.Generator) -> Array:
    """Return (N, n) positions within the limits of positions: the centre, and random ones.

    Each is on a straight way from the centre, at a random part of where it leaves the limits.
    """
    lower, upper = limits.range
    n = len(centre)
    span = np.where(np.isfinite(upper - lower), upper - lower, 2.0 * np.pi)[:n]
    way = random.normal(size=(_DRAWS, n)) * span
    along, here = way @ limits.rows.T, limits.rows @ centre
    with np.errstate(divide="ignore", invalid="ignore"):
        far = np.where(along > 0.0, (upper - here) / along, (lower - here) / along)
    far = np.where(np.isfinite(far), far, np.inf).min(axis=1)
    far = np.minimum(far, 1.0) * random.uniform(0.0, 1.0, _DRAWS)
    return np.vstack([centre, centre + far[:, None] * way])
