"""How far a motion stays from each of its limits, between the points of a grid, too.

A function f with |f''| <= M is nowhere greater than the greater of its values at two points h apart
plus M h^2 / 8. M comes from the next derivatives of the series, of which the coefficients are
known (:meth:`FourierMotion.bound`), so positions, velocities and accelerations are proven. A link
moves between two points no further from the nearer than h / 2 times its greatest speed, and that is
no greater than its levers' times the joints': proven, too. The slope of the torque follows from the
model alone: half of its largest change from one point to the next is added, which is an estimate.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects import State
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.planning.limits import Box, PlanLimits
from dvrk_gravity.planning.places import link_origins

STEP = 0.005  # s, of the grid: of .6 Hz the proof adds 5e-5 of an acceleration
WITHIN = 1.96  # standard deviations: 95 % of a normal distribution
ROUNDING = 1e-9  # of limits, which files have in degrees
KINDS = ("position", "velocity", "acceleration", "effort", "distance")
# What a straight move must be checked for. Its duration keeps velocities and accelerations, and
# between two positions within limits it stays within them.
UNSEEN = ("effort", "distance")
_BLOCK = 4000  # samples worked on at a time


class Path(Protocol):
    """A motion of which it is known how much it can exceed its values between points."""

    def at(self, time: Array) -> tuple[Array, Array, Array]:
        """Return (N, n) positions, velocities and accelerations at (N,) times."""

    def grid(self, step: float, rows: Array) -> tuple[Array, Array]:
        """Return times and what values may exceed beside each: :meth:`FourierMotion.grid`."""


@dataclass(frozen=True)
class Slack:
    """What a motion leaves of one limit.

    Attributes:
        limit: ``position``, ``velocity``, ``acceleration``, ``effort`` or ``distance``.
        of: The joint, combination, motor, or box and link.
        used: Part of the limit that is used; 1 is at the limit. Of a box 1 is at its side.
        left: What is left, in the limit's unit; negative beyond it.
        unit: Its unit.
    """

    limit: str
    of: str
    used: float
    left: float
    unit: str


def slacks(
    motion: Path, limits: PlanLimits, arm: Arm, model: TorqueModel | None = None
) -> list[Slack]:
    """Return what a motion leaves of each of its limits.

    Args:
        motion: The motion.
        limits: What it is to keep.
        arm: The arm.
        model: For the torque, with its own 95 % band; ``None``: torques are not known.
    """
    time, margins = motion.grid(STEP, limits.rows)
    peaks = np.full((3, len(limits.rows)), -np.inf)
    lowest, effort, change = peaks[0].copy(), np.zeros(arm.n), np.zeros(arm.n)
    nearest = np.full(sum(len(box.links) for box in limits.boxes), np.inf)
    for start in range(0, len(time) - 1, _BLOCK):
        part = slice(start, start + _BLOCK + 1)  # each block begins where the last one ends
        states = motion.at(time[part])
        extra = margins[:, part]
        ways = [each @ limits.rows.T for each in states]
        lowest = np.maximum(lowest, (extra[0] - ways[0]).max(axis=0))
        for k, way in enumerate(ways):
            peaks[k] = np.maximum(peaks[k], ((way if k == 0 else np.abs(way)) + extra[k]).max(0))
        if model is not None:
            load, size = efforts(model, State(*states))
            effort = np.maximum(effort, load.max(axis=0))
            change = np.maximum(change, np.abs(np.diff(size, axis=0)).max(axis=0, initial=0.0))
        if limits.boxes:
            nearest = np.minimum(nearest, distances(arm, limits.boxes, states[0]).min(axis=0))
    found = _kinematic(limits, arm, peaks, -lowest)
    if model is not None:
        for k, name in enumerate(arm.joint_names):
            found.append(
                _slack("effort", f"{name}'s motor", float(effort[k] + 0.5 * change[k]),
                       float(limits.effort[k]), arm.effort_units[k])
            )  # fmt: skip
    if limits.boxes:
        fastest = np.abs(peaks[1][: arm.n]) + 0.5 * STEP * limits.acceleration
        away = nearest - 0.5 * STEP * _speeds(arm, limits.boxes, fastest)
        for name, left in zip(box_links(limits.boxes), away.tolist(), strict=True):
            found.append(Slack("distance", name, float(left <= 0.0), left, "m"))
    return found


def kept_parts(motion: Path, limits: PlanLimits, about: Array) -> Array:
    """Return (n,) the largest parts of the joints' ways about (n,) positions that they may go.

    By their own limits of position, velocity and acceleration, between grid points, too.
    """
    n = len(about)
    time, margins = motion.grid(STEP, np.eye(n))
    parts = np.ones(n)
    for start in range(0, len(time), _BLOCK):
        at = slice(start, start + _BLOCK)
        (q, qd, qdd), extra = motion.at(time[at]), margins[:, at]
        ways = [q - about + extra[0], about - q + extra[0], abs(qd) + extra[1], abs(qdd) + extra[2]]
        room = [limits.upper - about, about - limits.lower, limits.velocity, limits.acceleration]
        for way, most in zip(ways, room, strict=True):
            peak = way.max(axis=0)
            part = np.divide(most, peak, out=np.ones(n), where=peak > most)
            parts = np.minimum(parts, part)
    return np.where(parts < 1.0, (1.0 - ROUNDING) * parts, 1.0)


def worst_violation(
    motion: Path,
    limits: PlanLimits,
    arm: Arm,
    model: TorqueModel | None = None,
    kinds: Sequence[str] = KINDS,
) -> Slack | None:
    """Return the slack of the limit that a motion violates most, ``None``: it keeps all.

    Args:
        motion: The motion.
        limits: What it is to keep.
        arm: The arm.
        model: For the torque; ``None``: torques are not known.
        kinds: Limits to look at.
    """
    beyond = [
        slack
        for slack in slacks(motion, limits, arm, model)
        if slack.limit in kinds and not slack.left >= -ROUNDING
    ]
    return max(beyond, key=lambda slack: slack.used, default=None)


def _kinematic(limits: PlanLimits, arm: Arm, peaks: Array, lowest: Array) -> list[Slack]:
    units = [*arm.units, *(_unit(arm, dict(each.factors)) for each in limits.combinations)]
    lower, upper = limits.range
    found = []
    for k, name in enumerate(limits.names):
        low, high = float(lower[k]), float(upper[k])
        if np.isfinite(low) or np.isfinite(high):
            left = min(float(lowest[k]) - low, high - float(peaks[0, k]))
            half = 0.5 * (high - low)
            used = 1.0 - left / half if half > 0.0 and np.isfinite(half) else float(left <= 0.0)
            found.append(Slack("position", name, used, left, units[k]))
        for kind, peak, limit, per in zip(
            ("velocity", "acceleration"), peaks[1:, k], (rate[k] for rate in limits.rates),
            ("/s", "/s^2"), strict=True,
        ):  # fmt: skip
            if np.isfinite(limit):
                found.append(_slack(kind, name, float(peak), float(limit), units[k] + per))
    return found


def _unit(arm: Arm, factors: dict[str, float]) -> str:
    return arm.units[arm.joint_names.index(next(iter(factors)))]


def _slack(kind: str, name: str, peak: float, limit: float, unit: str) -> Slack:
    return Slack(kind, name, peak / limit, limit - peak, unit)


def effort_band(model: TorqueModel, state: State) -> tuple[Array, Array]:
    """Return the (N, n) efforts of the actuators, and the half widths of the model's 95 % band.

    The band is that of its posterior and its known error; zero where it has neither.
    """
    arm, known = model.arm, model.uncertainty
    torque = arm.actuator_effort(model.torque_at(state))
    if known is None:
        return torque, np.zeros_like(torque)
    true = State(state.q - model.joint_offset, state.qd, state.qdd)
    directions = known.torque(model.terms, true)
    spread = np.matmul(arm.actuator_to_joint.T, directions)
    # Of motors that turn several joints, errors of the joints that may add up.
    error = np.nan_to_num(known.error) @ np.abs(arm.actuator_to_joint)
    return torque, WITHIN * np.sqrt(np.sum(spread**2, axis=-1) + error**2)


def efforts(model: TorqueModel, state: State) -> tuple[Array, Array]:
    """Return (N, n) greatest sizes of efforts within :func:`effort_band`, and the efforts."""
    torque, band = effort_band(model, state)
    return np.abs(torque) + band, torque


def box_links(boxes: tuple[Box, ...]) -> list[str]:
    """Return a name for each link that a box keeps out, box by box."""
    return [f"{link} from {box.name}" for box in boxes for link in box.links]


def distances(arm: Arm, boxes: tuple[Box, ...], q: Array) -> Array:
    """Return (N, boxes' links) distances from each box along an axis, m; negative inside.

    No further than the true distance, and as continuous: the greatest by axis.
    """
    return box_violations(arm, boxes, q)[0]


def box_violations(arm: Arm, boxes: tuple[Box, ...], q: Array) -> tuple[Array, Array]:
    """Return (N, m) :func:`distances`, and (N, m, 3) their slopes by the links' places."""
    found, slopes = [], []
    for box in boxes:
        places = link_origins(arm, box.links, q)
        sides = np.concatenate(
            [np.array(box.lower) - places, places - np.array(box.upper)], axis=-1
        )
        most = sides.argmax(axis=-1)
        found.append(np.take_along_axis(sides, most[..., None], axis=-1)[..., 0])
        slopes.append(np.vstack([-np.eye(3), np.eye(3)])[most])
    return np.concatenate(found, axis=1), np.concatenate(slopes, axis=1)


def _speeds(arm: Arm, boxes: tuple[Box, ...], fastest: Array) -> Array:
    """Return (boxes' links,) bounds of the links' speeds, m/s, by (n,) speeds of the joints.

    A lever is no longer than the offsets of the bodies from the joint on, those that slide at
    their furthest.
    """
    by_link = {link: _reach(arm, link) @ fastest for box in boxes for link in box.links}
    return np.array([by_link[link] for box in boxes for link in box.links])


def _reach(arm: Arm, link: str) -> Array:
    """Return (n,) bounds of the levers of each joint to a link's origin, m/rad or m/m."""
    k = arm.body_names.index(link)
    away = float(np.linalg.norm(arm.bodies[k].frame.translation))
    lower, upper = arm.range
    found = np.zeros(arm.n)
    while k >= 0:
        body = arm.bodies[k]
        if body.kind == "prismatic":
            found += np.abs(body.row)
            away += float(np.abs(body.row) @ np.maximum(np.abs(lower), np.abs(upper)))
        else:
            found += np.abs(body.row) * away
        away += float(np.linalg.norm(body.placement.translation))
        k = body.parent
    return found
