"""Where a motion may begin and end: at rest within all limits; or which limit leaves no place."""

from __future__ import annotations

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects import State
from dvrk_gravity.errors import PlanError
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.planning.keeping import box_links, distances, efforts
from dvrk_gravity.planning.limits import PlanLimits
from dvrk_gravity.units import quantity

_DRAWS = 4000  # random positions that are looked at
_ROUNDING = 1e-9


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
    q = _draw_positions(limits, centre, random)
    room = np.ones(len(q))
    others = _other_slacks(limits, arm, model, q)
    for _, left, _, size in others:
        room = np.minimum(room, left / size)
    at = int(np.argmax(room))
    if room[at] < 0.0:
        # One that is nowhere kept, if there is one; else those that exclude each other.
        alone = [each for each in others if each[1].max() < 0.0]
        if alone:
            name, left, unit, _ = alone[0]
            short = f"{name} would have to give {quantity(-float(left.max()), unit)}"
        else:
            gives = [
                f"{name} {quantity(-float(left[at]), unit)}"
                for name, left, unit, _ in others
                if left[at] < 0.0
            ]
            short = f"together; of them would have to give: {', '.join(gives)}"
        raise PlanError(
            f"no position keeps all limits: {short} (at the best of {len(q)} positions)"
        )
    order = np.argsort(-room, kind="stable")
    return q[order[: min(count, int(np.sum(room >= 0.0)))]]


def _other_slacks(
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
                f"no position keeps all limits: those of {name} would have to give "
                f"{quantity(lower[k] - upper[k], _unit(limits, arm, k))}, the lower one is above "
                "the upper one"
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
    if room < 0.0:
        raise PlanError(f"no position keeps all limits: {_conflict(limits, arm)}")
    return np.asarray(q)


def _conflict(limits: PlanLimits, arm: Arm) -> str:
    """Return which combinations exclude each other, and the least by which they have to give.

    The joints' own limits are kept.
    """
    from scipy.optimize import linprog

    lower, upper = limits.range
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
        f"those of {each.name} ({_shown(limits, arm, own + k)}) would have to give "
        f"{quantity(gives, _unit(limits, arm, own + k))}"
        for k, (each, gives) in enumerate(
            zip(limits.combinations, found.x[own:].tolist(), strict=True)
        )
        if gives > _ROUNDING
    ]
    return ", and ".join(short)


def _unit(limits: PlanLimits, arm: Arm, row: int) -> str:
    return arm.units[int(np.flatnonzero(limits.rows[row])[0])]


def _shown(limits: PlanLimits, arm: Arm, row: int) -> str:
    low, high = (float(ends[row]) for ends in limits.range)
    shown = arm.joints[int(np.flatnonzero(limits.rows[row])[0])].shown
    return f"{shown(low).split()[0]} to {shown(high)}"


def _draw_positions(limits: PlanLimits, centre: Array, random: np.random.Generator) -> Array:
    """Return (N, n) positions within the limits of positions: the centre, and random ones.

    Each is on a straight way from the centre, at a random part of where it leaves the limits,
    further out more often than near.
    """
    lower, upper = limits.range
    n = len(centre)
    span = np.where(np.isfinite(upper - lower), upper - lower, 2.0 * np.pi)[:n]
    way = random.normal(size=(_DRAWS, n)) * span
    along, here = way @ limits.rows.T, limits.rows @ centre
    with np.errstate(divide="ignore", invalid="ignore"):
        far = np.where(along > 0.0, (upper - here) / along, (lower - here) / along)
    far = np.where(np.isfinite(far), far, np.inf).min(axis=1)
    far = np.minimum(far, 1.0) * np.sqrt(random.uniform(0.0, 1.0, _DRAWS))
    return np.vstack([centre, centre + far[:, None] * way])
