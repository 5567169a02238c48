"""Friction: where it can be, and the terms with levels at joints and motors."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import ClassVar, Self

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects.base.arrays import diagonal_columns, motor_columns
from dvrk_gravity.effects.base.column import Column, ColumnTable, SearchMove
from dvrk_gravity.effects.base.linear_term import LinearTerm, Unknowns
from dvrk_gravity.effects.base.motion import Motion, State
from dvrk_gravity.effects.base.polynomials import Range
from dvrk_gravity.effects.base.site import Kind, Site, mixed_motors


@dataclass(frozen=True, eq=False)
class Friction(LinearTerm):
    """Friction with coefficients at the joints and at the motors.

    Friction at a motor acts on every joint that the motor moves: tau = level_j s(qd_j) +
    J' (level_m s(J qd)) with J from joint to motor velocities and s a function of one velocity.

    Its ``COEFFICIENTS`` are in N·m per unit of s.

    Attributes:
        arm: The arm, for its transmission.
    """

    FRICTION = True
    OF_POSITION = False
    BY_MOTION = True
    SITES = (Kind.JOINT, Kind.MOTOR)
    COEFFICIENTS: ClassVar[tuple[str, ...]] = ("joint", "motor")

    arm: Arm

    def scaled(self, part: Array) -> Self:
        return replace(self, **{name: part * getattr(self, name) for name in self.COEFFICIENTS})

    @classmethod
    def unknowns(cls, arm: Arm, valid: Range) -> Unknowns | None:
        found = super().unknowns(arm, valid)
        return None if found is None else found.at(sites_with_friction(arm))

    @classmethod
    def moves(cls, table: ColumnTable, inside: set[int]) -> Iterator[SearchMove]:
        """Add and remove a site's friction, take the next setting, exchange joint and motor."""
        for site in sites_with_friction(table.arm):
            here = table.select(cls.NAME, site)
            chosen = tuple(index for index in here if index in inside)
            text = f"{cls.NAME} {site_text(table.arm, site)}"
            if chosen and cls.may_be_absent(table, inside, site.index):
                yield SearchMove((), chosen, f"without {text}")
            for before, index, after in zip((-1, *here), here, (*here[1:], -1), strict=False):
                if index not in inside and (not chosen or {before, after} & inside):
                    setting = cls.setting_text(table.arm, table.columns[index])
                    yield SearchMove((index,), chosen, text + setting)
        yield from moves_between(cls.NAME, table, inside)

    @classmethod
    def setting_text(cls, arm: Arm, column: Column) -> str:
        """Return how a column's setting follows its name in a report; ``""``: it has none."""
        return ""

    @classmethod
    def may_be_absent(cls, table: ColumnTable, inside: set[int], joint: int) -> bool:
        """Return whether a search may remove a joint's columns."""
        return True

    @classmethod
    def minimal_columns(cls, table: ColumnTable) -> list[int]:
        """At every joint or, where that is likelier, at its motor, if every arm has it."""
        return [
            index
            for joint in range(table.arm.n if cls.EVERYWHERE else 0)
            for index in table.select(cls.NAME, _likely_site(table.arm, joint), 0)
        ]


def columns_at_sites(arm: Arm, joint: Array, motor: Array) -> Array:
    """Return (N, n, 2 n) torques of coefficients at joints and motors, from (N, n) values each."""
    return np.concatenate([diagonal_columns(joint), motor_columns(arm, motor)], axis=-1)


def velocities(arm: Arm, state: State) -> tuple[Array, Array] | None:
    """Return (…, n) velocities or directions of the joints and of the motors, if known."""
    motion = state.qd if state.direction is None else state.direction
    return None if motion is None else (motion, arm.actuator_position(motion))


def friction_sites(motion: Motion) -> Iterator[Site]:
    """Yield joints that move, and motors that move more than a joint of their own."""
    arm, way = motion.arm, motion.direction
    both_ways = np.zeros(arm.n, dtype=bool) if way is None else np.ptp(way, axis=0) > 0.0
    for joint, name in enumerate(arm.joint_names):
        if (motion.moves[joint] or both_ways[joint]) and name not in arm.frictionless:
            yield Site.joint(joint)
    for motor in mixed_motors(arm):
        if motion.moves[arm.joint_to_actuator[motor] != 0.0].any() and motion.present.all():
            yield Site.motor(motor)


def removable(motion: Motion, where: Site, torque: Array) -> float:
    """Return how much friction of one kind dissipates the power of all the model's there.

    Were there less by more than that, friction would drive the arm.

    Args:
        motion: The motion; static poses dissipate no power and set no limit.
        where: A joint, or a motor that moves several.
        torque: (N,) torque at that site of one unit of the friction.
    """
    row = where.row(motion.arm)
    unit = float(torque @ (motion.qd @ row))
    if unit <= 0.0:
        return np.inf
    moved = row != 0.0
    return max(float((motion.friction * motion.qd)[:, moved].sum()), 0.0) / unit


@lru_cache(maxsize=8)
def sites_with_friction(arm: Arm) -> tuple[Site, ...]:
    """Return where friction may be: joints, unless they have none, and motors that move several."""
    mixed = mixed_motors(arm)
    return tuple(
        site
        for joint, name in enumerate(arm.joint_names)
        for site, has in (
            (Site.joint(joint), name not in arm.frictionless),
            (Site.motor(joint), joint in mixed),
        )
        if has
    )


def _likely_site(arm: Arm, joint: int) -> Site:
    """Return where it is likelier: at a motor that moves another joint as far as its own."""
    row = np.abs(arm.joint_to_actuator[joint])
    shared = np.delete(row, joint).max(initial=0.0) >= row[joint]
    at_motor = shared or arm.joint_names[joint] in arm.frictionless
    return Site.motor(joint) if at_motor else Site.joint(joint)


def site_text(arm: Arm, site: Site) -> str:
    """Return a joint's name, with the kind of site if friction may be at either."""
    name = arm.joint_names[site.index]
    either = [each.index for each in sites_with_friction(arm)].count(site.index) > 1
    return f"{name} ({site.kind.value})" if either else name


def moves_between(effect: str, table: ColumnTable, inside: set[int]) -> Iterator[SearchMove]:
    """Yield the moves of a joint's friction to its motor and back."""
    for joint in mixed_motors(table.arm):
        here, there = (
            table.select(effect, site) for site in (Site.joint(joint), Site.motor(joint))
        )
        if not here or not there:
            continue
        for old, new, kind in ((here, there, "motor"), (there, here, "joint")):
            pairs = [
                (a, b) for a, b in zip(old, new, strict=True) if a in inside and b not in inside
            ]
            if pairs:
                gone, come = zip(*pairs, strict=True)
                # Of several settings a site has one: that which comes.
                gone += tuple(b for b in new if b in inside and table.columns[b].alternative)
                text = f"{effect} {table.arm.joint_names[joint]} at the {kind}"
                yield SearchMove(come, gone, text)
