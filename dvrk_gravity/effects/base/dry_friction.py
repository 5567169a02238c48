"""Dry friction: a level against the motion, which builds up with displacement after a reversal."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array, Mask
from dvrk_gravity.effects.base.arrays import Values, as_array, as_value
from dvrk_gravity.effects.base.column import (
    PRIOR_FRACTION,
    Column,
)
from dvrk_gravity.effects.base.dahl import dahl
from dvrk_gravity.effects.base.friction import Friction, sites_with_friction, velocities
from dvrk_gravity.effects.base.linear_term import Unknowns
from dvrk_gravity.effects.base.motion import State
from dvrk_gravity.effects.base.site import Kind, effort_limits
from dvrk_gravity.effects.base.term import Term
from dvrk_gravity.parameters import Value

BUILT_UP = "builds up over that after a reversal; 0: at once"
"""What the displacements of a dry friction are, for its schema."""

TRANSITION = 0.003
"""rad/s (Arm.scale) over which a friction that is identified changes its sign."""

_SIGN = 1e9  # slope that makes the ramp a sign function, while 0 stays 0
_STILL = 1e-9  # rad/s or m/s: what filtering leaves of an arm at rest has a sign


class DryFriction(Friction):
    """Friction whose direction is that of the motion, whatever its speed.

    The direction of a joint or motor goes from one to the other along Dahl's curve (Dahl 1968):
    gears give before they slip, by 1 or 2 mrad. Where that displacement is zero, or a single
    sample has no past, it is linear in the velocity below the transition velocity, so that a
    command does not jump when the motion reverses.

    Class attributes:
        SETTING: Name of what a fit chooses for each site: ``joint_…`` and ``motor_…`` of it are
            attributes.
        SETTING_UNIT: Its unit at a joint that turns.
        SETTING_TEXT: How a coefficient's name says it.
        SETTINGS: The values that a fit chooses from, for joints that turn (Arm.scale).

    Attributes, which subclasses declare:
        transition_velocity: (n,) rad/s; 0 makes it a sign function.
        joint_displacement: (n,) rad over which it builds up at the joints.
        motor_displacement: (n,) rad over which it builds up at the motors.
    """

    SETTING: ClassVar[str]
    SETTING_UNIT: ClassVar[str]
    SETTING_TEXT: ClassVar[str]
    SETTINGS: ClassVar[tuple[float, ...]]

    transition_velocity: Array
    joint_displacement: Array
    motor_displacement: Array

    @classmethod
    def displacements(cls, arm: Arm, values: Values) -> tuple[Array, Array]:
        """Return (n,) displacements of the joints and of the motors that parameters have."""
        joint, motor = (
            as_array(values.get(f"{cls.NAME}.{kind}_displacement"), arm.n, 0.0)
            for kind in ("joint", "motor")
        )
        return joint, motor

    def displacement_parameters(self, kinds: Iterable[str]) -> dict[str, Value]:
        """Return the parameters that :meth:`displacements` reads, where they are not zero.

        Args:
            kinds: ``joint``, ``motor``: where there are levels.
        """
        lengths = {kind: getattr(self, f"{kind}_displacement") for kind in kinds}
        return {
            f"{self.NAME}.{kind}_displacement": as_value(length)
            for kind, length in lengths.items()
            if length.any()
        }

    @property
    def full_speed(self) -> Array:
        return self.transition_velocity

    @property
    def displacement(self) -> Array:
        """(2, n) rad, of the joints and of the motors."""
        return np.array([self.joint_displacement, self.motor_displacement])

    @property
    def has_memory(self) -> bool:
        """Whether it builds up anywhere."""
        return bool(self._builds_up.any())

    @cached_property
    def _builds_up(self) -> Mask:
        return self.displacement.ravel() > 0.0

    @cached_property
    def _slope(self) -> Array:
        return 1.0 / np.maximum(self.transition_velocity, 1.0 / _SIGN)

    def memory(self, state: State, before: Array | None = None) -> Array:
        """Return (N, 2 n) directions of joints and motors, as built up along the motion.

        (N, 0) where nothing builds up.
        """
        known = velocities(self.arm, state)
        if not self.has_memory:
            return np.zeros((len(state.q), 0))
        found = np.zeros((len(state.q), len(self._builds_up)))
        if known is None or state.direction is not None:
            return found
        if before is None:
            first = np.concatenate([motion[0] for motion in known])
            before = np.where(np.abs(first) > _STILL, np.sign(first), 0.0)
        position = np.hstack([state.q, self.arm.actuator_position(state.q)])
        length = self.displacement.ravel()
        for place in np.flatnonzero(self._builds_up).tolist():
            own = slice(place, place + 1)
            found[:, own] = dahl(position[:, place], length[own], before[own])
        return found

    def ways(self, state: State, memory: Array | None = None) -> tuple[Array, Array] | None:
        """Return (…, n) directions of joints and motors, -1 to 1; ``None``: no motion is known.

        Args:
            state: The state.
            memory: (N, 2 n) of :meth:`memory`; ``None``: nothing has built up.
        """
        motion = velocities(self.arm, state)
        if motion is None:
            return None
        slope = self._slope if state.direction is None else _SIGN  # no speed: friction is full
        joint, motor = (np.clip(each * slope, -1.0, 1.0) for each in motion)
        if memory is not None and memory.shape[1] and state.direction is None:
            built = np.split(memory, 2, axis=1)
            up = np.split(self._builds_up, 2)
            joint, motor = (
                np.where(gives, slow, ramp)
                for gives, slow, ramp in zip(up, built, (joint, motor), strict=True)
            )
        return joint, motor

    def past(self, state: State) -> Array | None:
        """Return the :meth:`memory` of a state that has a past, else ``None``."""
        return self.memory(state) if state.q.ndim == 2 and len(state.q) > 1 else None

    def regressor(self, state: State) -> Array:
        past = self.past(state)
        return self.columns(state, np.zeros((len(state.q), 0)) if past is None else past)

    def split(self, part: Array) -> tuple[Term | None, Term | None]:
        lengths = ("joint_displacement", "motor_displacement")
        at_once: dict[str, Any] = dict.fromkeys(lengths, np.zeros(self.arm.n))
        return None, replace(self, **at_once).scaled(part)  # a compensator knows no past

    # Identified.
    @classmethod
    def for_settings(cls, term: DryFriction, basis: Array) -> Unknowns:
        """Return the unknowns of a term, its levels zero, for each of the settings.

        Args:
            term: The term.
            basis: (k, 2 n) from levels of the joints and of the motors to its theta.
        """
        arm = term.arm
        sites = sorted(sites_with_friction(arm), key=lambda site: site.kind is Kind.MOTOR)
        scales = {kind: PRIOR_FRACTION * effort_limits(arm, kind) for kind in cls.SITES}
        columns = tuple(
            Column(
                cls.NAME, site, setting, float(scales[site.kind][site.index]), True, "N·m",
                alternative=True,
            )
            for setting in range(len(cls.SETTINGS))
            for site in sites
        )  # fmt: skip
        joints = [site.index + arm.n * (site.kind is Kind.MOTOR) for site in sites]
        places = np.tile(joints, len(cls.SETTINGS))
        return SettingUnknowns(term=term, columns=columns, basis=basis[:, places], places=places)

    @classmethod
    def setting_text(cls, arm: Arm, column: Column) -> str:
        value = cls.SETTINGS[column.index]
        unit = column.site.unit(arm, cls.SETTING_UNIT)
        return f" {cls.SETTING_TEXT} {value:g} {unit}" if value else ""

    @classmethod
    def coefficient_name(cls, arm: Arm, column: Column) -> str:
        return super().coefficient_name(arm, column) + cls.setting_text(arm, column)


@dataclass(frozen=True, eq=False, kw_only=True)
class SettingUnknowns(Unknowns):
    """Levels for each of several settings; a term has one setting at a site.

    Attributes:
        places: (p,) joint of each column, or n plus its motor.
    """

    term: DryFriction
    basis: Array
    places: NDArray[np.int64]

    @cached_property
    def _terms(self) -> list[DryFriction]:
        """The term with each of the settings at all sites."""
        return [
            self._with(np.full(2 * self.term.arm.n, value)) for value in type(self.term).SETTINGS
        ]

    def _with(self, setting: Array) -> DryFriction:
        """Return the term with (2 n,) settings, for joints that turn."""
        joint, motor = np.split(setting * np.tile(self.term.arm.scale, 2), 2)
        name = self.term.SETTING
        changed: dict[str, Any] = {f"joint_{name}": joint, f"motor_{name}": motor}
        return replace(self.term, **changed)

    def _split(self, memory: Array) -> list[Array]:
        """Return each setting's part of (…, m) memory."""
        sizes = [2 * self.term.arm.n * term.has_memory for term in self._terms]
        return np.split(memory, np.cumsum(sizes)[:-1], axis=-1)

    def memory(self, state: State, before: Array | None = None) -> Array:
        known = [None] * len(self._terms) if before is None else self._split(before)
        parts = zip(self._terms, known, strict=True)
        return np.concatenate([term.memory(state, part) for term, part in parts], axis=1)

    def regressor(self, state: State, memory: Array) -> Array:
        found = np.zeros((*state.q.shape, len(self.columns)))
        for number, (term, part) in enumerate(zip(self._terms, self._split(memory), strict=True)):
            own = [i for i, column in enumerate(self.columns) if column.index == number]
            found[..., own] = term.columns(state, part) @ self.basis[:, own]
        return found

    def found(self, coefficients: Array) -> DryFriction | None:
        """Return the term with (p,) coefficients, ``None`` if all are zero.

        Of several settings at a site, it has that of the largest level.
        """
        if not coefficients.any():
            return None
        settings = type(self.term).SETTINGS
        chosen = np.full(2 * self.term.arm.n, settings[0])
        for i in np.argsort(np.abs(coefficients), kind="stable").tolist():
            if coefficients[i]:
                chosen[self.places[i]] = settings[self.columns[i].index]
        return self._with(chosen).with_theta(self.basis @ coefficients)
