"""Friction that builds up with displacement after the motion reverses."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array, Mask
from dvrk_gravity.effects.base.arrays import Values, as_value, numbers, read_rows, write_rows
from dvrk_gravity.effects.base.column import (
    PRIOR_FRACTION,
    Column,
    ColumnTable,
    SearchMove,
    site_columns,
)
from dvrk_gravity.effects.base.dahl import DahlElements, dahl, dahl_of_parts
from dvrk_gravity.effects.base.effect import Hypothesis, spread
from dvrk_gravity.effects.base.friction import (
    Friction,
    columns_at_sites,
    friction_sites,
    moves_between,
    site_text,
    sites_with_friction,
    velocities,
)
from dvrk_gravity.effects.base.linear_term import Unknowns
from dvrk_gravity.effects.base.meaning import MORE, Estimate, Meaning, Words, meanings, size
from dvrk_gravity.effects.base.motion import Motion, State
from dvrk_gravity.effects.base.polynomials import Range
from dvrk_gravity.effects.base.site import Site, effort_limits
from dvrk_gravity.effects.base.term import PlantPart
from dvrk_gravity.effects.coulomb_friction import CoulombFriction, with_coulomb
from dvrk_gravity.parameters import Parameter, Value

_MOST = 8
_FAR = 1e6  # rad
_MOMENT = 0.2  # s
# Speed of an arm at rest, rad/s or m/s: what filtering leaves of it, 1e-12 by rounding, has a sign.
_STILL = 1e-9
DISPLACEMENTS = (0.01, 0.03, 0.1, 0.3)  # rad, of the elements that are identified
_DISPLACEMENTS = (1e-4, 10.0)  # rad
_RESOLVED = 3.0  # encoder steps that a displacement must have to be seen
_REPLACED = 1.5  # times the model's Coulomb friction: more than that, it cannot take away
_LENGTHS = (0.02, 0.06, 0.15, 0.35)  # of half the joint's range, from which the search begins


@dataclass(frozen=True, eq=False)
class PreslidingHysteresis(Friction):
    """Elements in parallel, each an elastic contact that yields (Dahl 1968; Maxwell slip).

    Element k pushes with levels[k] z_k against the motion of a joint or motor, where
    dz_k = (sign(dx) - z_k) |dx| / displacement[k]: after a reversal it takes that displacement, not
    a time, to build up. Samples of an (N, n) state are in order of time; before the first one the
    arm is taken to have slid as it does there; at rest, the elements are relaxed. A single sample
    has no past, and a velocity then gives the final level.

    Attributes:
        arm: The arm, for its transmission.
        displacement: (K,) rad.
        joint: (K, n) levels at the joints, N·m.
        motor: (K, n) levels at the motors, N·m.
    """

    NAME = "presliding_hysteresis"
    IN_FILES = ("console",)
    DIVIDED_WITH = (CoulombFriction,)
    REMEDY = "let the arm move a little before a reading counts"
    MEANINGS = meanings(
        level=Meaning("N·m", 0.0, least=0.0),
        length=Meaning("rad", label="builds up over", least=0.0),
        coulomb=size("N·m", MORE, "Coulomb friction beside it"),
    )
    COMPENSATED = False

    displacement: Array
    joint: Array
    motor: Array

    @classmethod
    def schema(cls, arm: Arm) -> tuple[Parameter, ...]:
        lengths = tuple(range(1, _MOST + 1))
        return (
            Parameter(
                f"{cls.NAME}.displacement", (), "rad",
                "displacement over which each element builds up",
                lower=_DISPLACEMENTS[0], upper=_DISPLACEMENTS[1], lengths=lengths,
            ),
            *(
                Parameter(
                    f"{cls.NAME}.{kind}.{joint.name}", (), joint.effort_unit,
                    f"friction of each element at the {kind}, {joint.name}",
                    lower=0.0, lengths=lengths,
                )
                for kind in cls.COEFFICIENTS
                for joint in arm.joints
            ),
        )  # fmt: skip

    @classmethod
    def from_parameters(cls, arm: Arm, values: Mapping[str, Value]) -> PreslidingHysteresis | None:
        displacement = numbers(values, f"{cls.NAME}.displacement")
        if not displacement:
            return None
        expected = f"{len(displacement)}, as many as {cls.NAME}.displacement"
        joint, motor = (
            read_rows(arm, values, f"{cls.NAME}.{kind}", len(displacement), expected)
            for kind in cls.COEFFICIENTS
        )
        return cls(arm, np.array(displacement), joint, motor)

    def parameters(self) -> dict[str, Value]:
        values: dict[str, Value] = {f"{self.NAME}.displacement": as_value(self.displacement)}
        for kind in self.COEFFICIENTS:
            values |= write_rows(self.arm, f"{self.NAME}.{kind}", getattr(self, kind))
        return values

    def torque(self, state: State) -> Array:
        """Return (…, n) friction torques, N·m; zero where no motion is known."""
        levels = np.stack([self.joint, self.motor], axis=1)
        elements = self.elements(state, used=levels != 0.0)
        felt = (levels * elements).sum(axis=-3)
        return felt[..., 0, :] + self.arm.joint_effort(felt[..., 1, :])

    def elements(
        self, state: State, before: Array | None = None, used: Mask | None = None
    ) -> Array:
        """Return (…, K, 2, n) states z of the elements, -1 to 1: at the joints, at the motors.

        Args:
            state: As :meth:`torque` takes it.
            before: (K, 2, n) states at the first of (N, n) samples, if known.
            used: (K, 2, n) elements that are asked for, by default all; others' states are zero.
        """
        count, n = len(self.displacement), state.q.shape[-1]
        known = velocities(self.arm, state)
        if known is None:
            return np.zeros((*state.q.shape[:-1], count, 2, n))
        motion = np.stack(known, axis=-2)
        if state.direction is not None or state.q.ndim != 2 or len(state.q) < 2:
            # Approached from far, or as far as the velocity goes in a moment.
            travel = _FAR if state.direction is not None else _MOMENT
            reach = travel / self.displacement
            return np.clip(motion[..., None, :, :] * reach[:, None, None], -1.0, 1.0)
        position = np.stack([state.q, self.arm.actuator_position(state.q)], axis=-2)
        if before is None:
            slid = np.where(np.abs(motion[0]) > _STILL, np.sign(motion[0]), 0.0)
            before = np.broadcast_to(slid, (count, 2, n))
        states = np.zeros((len(position), count, 2, n))
        used = np.ones((count, 2, n), dtype=bool) if used is None else used
        for kind, index in np.argwhere(used.any(axis=0)):
            some = np.flatnonzero(used[:, kind, index])
            states[:, some, kind, index] = dahl(
                position[:, kind, index], self.displacement[some], before[some, kind, index]
            )
        return states

    def plant(self) -> PlantPart:
        """Elements with a state, relaxed at first."""
        return PlantPart(memory=DahlElements(self.arm, self.displacement, self.joint, self.motor))

    @property
    def theta(self) -> Array:
        """(2 n K,) levels, for each element its joints, then its motors."""
        return np.concatenate([self.joint, self.motor], axis=1).ravel()

    def with_theta(self, theta: Array) -> PreslidingHysteresis:
        levels = np.reshape(theta, (len(self.displacement), 2, -1))
        return replace(self, joint=levels[:, 0], motor=levels[:, 1])

    def regressor(self, state: State) -> Array:
        return self._columns(self.elements(state))

    def memory(self, state: State, before: Array | None = None) -> Array:
        """Return (N, 2 n K) states of the elements."""
        shape = (len(self.displacement), 2, state.q.shape[-1])
        known = None if before is None else before.reshape(shape)
        return self.elements(state, known).reshape(len(state.q), -1)

    def columns(self, state: State, memory: Array) -> Array:
        count, n = state.q.shape
        return self._columns(memory.reshape(count, len(self.displacement), 2, n))

    def _columns(self, elements: Array) -> Array:
        """Return (N, n, 2 n K) regressor from (N, K, 2, n) states of the elements."""
        columns = [
            columns_at_sites(self.arm, elements[..., k, 0, :], elements[..., k, 1, :])
            for k in range(len(self.displacement))
        ]
        return np.concatenate(columns, axis=-1)

    def reduced(self) -> PreslidingHysteresis:
        """Return the elements that some joint or motor uses."""
        used = self.joint.any(axis=1) | self.motor.any(axis=1)
        return PreslidingHysteresis(
            self.arm, self.displacement[used], self.joint[used], self.motor[used]
        )

    @classmethod
    def unknowns(cls, arm: Arm, valid: Range) -> Unknowns:
        nothing = np.zeros((len(DISPLACEMENTS), arm.n))
        columns = [
            column
            for element in range(len(DISPLACEMENTS))
            for kind in cls.SITES
            for column in site_columns(
                cls.NAME, kind, PRIOR_FRACTION * effort_limits(arm, kind), element, True, "N·m"
            )
        ]
        term = cls(arm, np.array(DISPLACEMENTS), nothing, nothing)
        return Unknowns(term, tuple(columns)).at(sites_with_friction(arm))

    @classmethod
    def moves(cls, table: ColumnTable, inside: set[int]) -> Iterator[SearchMove]:
        """Add, remove and exchange elements."""
        for site in sites_with_friction(table.arm):
            elements = table.select(cls.NAME, site)
            for element, length in zip(elements, DISPLACEMENTS, strict=True):
                text = f"{cls.NAME} {site_text(table.arm, site)}, {length:g} rad"
                if element in inside:
                    yield SearchMove((), (element,), f"without {text}")
                    continue
                yield SearchMove((element,), (), text)
                for other in elements:
                    if other in inside:
                        yield SearchMove((element,), (other,), f"{text} instead of another")
        yield from moves_between(cls.NAME, table, inside)

    @classmethod
    def joint_start(cls, table: ColumnTable) -> list[int]:
        """All elements at all sites."""
        return table.select(cls.NAME)

    @classmethod
    def coefficient_name(cls, arm: Arm, column: Column) -> str:
        length = f"{DISPLACEMENTS[column.index]:g} {column.site.unit(arm, 'rad')}"
        return f"{super().coefficient_name(arm, column)} over {length}"

    @classmethod
    def hypotheses(cls, motion: Motion) -> Iterator[Hypothesis]:
        """With several displacements, beside the Coulomb friction or in its place."""
        for site in () if motion.static else friction_sites(motion):
            row = site.row(motion.arm)
            half = float(np.ptp(np.percentile(motion.q @ row, [1, 99]))) / 2
            # Within few encoder steps it resembles an effect of low speed.
            shortest = _RESOLVED * float(motion.step @ np.abs(row))
            for length in sorted({max(part * half, shortest) for part in _LENGTHS}):
                for known in (None, _known_coulomb(motion, site)):
                    yield PreslidingHypothesis(
                        arm=motion.arm, site=site, setting={"length": length},
                        shortest=shortest, known=known,
                    )  # fmt: skip


@dataclass(frozen=True, eq=False, kw_only=True)
class PreslidingHypothesis(Hypothesis):
    """One element at a joint or a motor; part of the model's Coulomb friction may be its.

    Attributes:
        shortest: Displacement below which the encoder resolves nothing, rad.
        known: The model's Coulomb friction there, N·m; ``None``: it is kept.
    """

    EFFECT = PreslidingHysteresis

    shortest: float
    known: float | None = None
    refine = ("length",)
    n_comparisons = len(_LENGTHS)
    extrapolates = False

    @property
    def _length(self) -> float:
        return max(self.setting["length"], self.shortest)

    def regressor(self, motion: Motion) -> Array:
        """Elements are relaxed at the beginning of every part."""
        row = self.site.row(self.arm)
        position = motion.q @ row
        state = dahl_of_parts(position, self._length, np.zeros(len(position)), motion)
        if self.known is None:
            return spread(row, state)
        return spread(row, state, motion.sign(row))

    def parameters(self, theta: Array) -> dict[str, float]:
        values = {"level": float(theta[0]), "length": self._length}
        return values | ({} if self.known is None else {"coulomb": float(theta[1])})

    def plausible(self, theta: Array) -> bool:
        """It replaces no Coulomb friction that the model does not have."""
        taken = 0.0 if self.known is None else -float(theta[1])
        return super().plausible(theta) and taken <= _REPLACED * (self.known or 0.0)

    def merge(self, values: Values, theta: Array, motion: Motion) -> Values | None:
        """Append an element, and change the Coulomb friction."""
        if theta[0] < 0.0:
            return None
        name = self.effect
        key = f"{name}.{self.site.kind.value}.{self.arm.joint_names[self.site.index]}"
        lengths = tuple(values.get(f"{name}.displacement") or ())
        length = float(np.clip(self.setting["length"], *_DISPLACEMENTS))
        result = {**values, f"{name}.displacement": (*lengths, length)}
        levels = tuple(f"{name}.{kind}." for kind in PreslidingHysteresis.COEFFICIENTS)
        for other in values:
            if other.startswith(levels) and values[other]:
                result[other] = (*values[other], 0.0)
        before = tuple(values.get(key) or np.zeros(len(lengths)).tolist())
        result[key] = (*before, float(theta[0]))
        return with_coulomb(self.arm, result, self.site, theta[1:]) if len(theta) > 1 else result

    def _claim(self, parameters: Mapping[str, Estimate], words: Words) -> str:
        beside = f", beside {words['coulomb']} Coulomb friction" if "coulomb" in words else ""
        return (
            f"friction of {self.site.words(self.arm)} builds up to {words['level']} over "
            f"{words['length']} after each reversal{beside}"
        )


def _known_coulomb(motion: Motion, where: Site) -> float:
    """Return the model's Coulomb friction at a site, a joint's with its motor's, N·m."""
    term = motion.model.term(CoulombFriction.NAME)
    return term.at(where) if isinstance(term, CoulombFriction) else 0.0
