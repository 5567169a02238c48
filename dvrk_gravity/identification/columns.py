"""The columns that a fit may use: what each is, its prior size, and its way into a model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity import gravity
from dvrk_gravity.arm import JOINT_NAMES, N_JOINTS, Arm
from dvrk_gravity.effects import (
    CoulombFriction,
    ElasticCable,
    LinearTerm,
    LinkInertia,
    PreslidingHysteresis,
    RotorInertia,
    State,
    Term,
    ViscousFriction,
    rigid_body,
)
from dvrk_gravity.effects.link_prior import (  # noqa: F401
    _samples,
    base_directions,
    beta_map,
)
from dvrk_gravity.effects.polynomial import Range
from dvrk_gravity.identification.posture import OFFSETS, Posture
from dvrk_gravity.recording.data import Array
from dvrk_gravity.tree import TREE_LINKS

SPRINGS = 4  # entries of beta, arm and forearm, that a balancing spring can add to
DEGREE = 7  # highest power of a joint's own position that is tried
DISPLACEMENTS = (0.01, 0.03, 0.1, 0.3)  # rad, of the elements of presliding
TRANSITION = 0.003  # rad/s over which Coulomb friction changes its sign
# What one effect may plausibly take of a motor's largest torque, as a standard deviation.
PART = 0.2
POSTURE = ("base_tilt", "joint_offset")  # effects that torque is not linear in
MISPLACED = 0.1  # rad, plausible size of a zero's or the base's error


@dataclass(frozen=True)
class Column:
    """One unknown of the fit.

    Attributes:
        effect: The term's name.
        place: ``joint`` or ``motor``; ``""`` for rigid-body combinations and the base.
        joint: Index of the joint or motor, -1 for rigid-body combinations and the base.
        index: Number within that: power of the position, element of presliding, roll or pitch.
        scale: Prior standard deviation, in the unit of the column's coefficient.
        positive: Must not be negative.
    """

    effect: str
    place: str
    joint: int
    index: int
    scale: float
    positive: bool = False

    @property
    def name(self) -> str:
        """Effect, joint and place in words."""
        if self.joint < 0:
            return f"{self.effect}[{self.index}]"
        place = " motor" if self.place == "motor" else ""
        return f"{self.effect} {JOINT_NAMES[self.joint]}{place}"


def _key(column: Column) -> tuple[str, str, int, int]:
    return column.effect, column.place, column.joint, column.index


class Columns:
    """All columns of one arm over one range of positions.

    Attributes:
        arm: The arm.
        posture: Where its joints and base are.
        mounted: The arm with its base as the posture has it.
        valid: Range of positions in the data.
        columns: What they are, in order.
    """

    def __init__(
        self, arm: Arm, lower: Array, upper: Array, posture: Posture | None = None
    ) -> None:
        """Lay the columns out for data between (7,) ``lower`` and ``upper`` measured positions."""
        self.arm = arm
        self.posture = Posture() if posture is None else posture
        self.mounted = self.posture.mounted(arm)
        self.valid = Range(lower - self.posture.offset, upper - self.posture.offset)
        limit = arm.actuator_effort_limit
        nothing = np.zeros(N_JOINTS)
        self._friction = CoulombFriction(
            arm, *(nothing,) * 4, transition_velocity=np.full(N_JOINTS, TRANSITION)
        )
        elements = np.zeros((len(DISPLACEMENTS), N_JOINTS))
        self._presliding = PreslidingHysteresis(arm, np.array(DISPLACEMENTS), elements, elements)
        self._terms: tuple[LinearTerm, ...] = (
            ElasticCable(arm, np.zeros((DEGREE + 1, N_JOINTS)), self.valid),
            self._friction,
            ViscousFriction(arm, nothing, nothing),
            RotorInertia(arm, nothing),
            self._presliding,
        )
        columns = [
            Column("link_inertia", "", -1, index, 1.0) for index in range(self.base.shape[1])
        ]
        # A spring that balances arm or forearm pulls like a mass and has no inertia.
        columns += [Column("gravity", "", -1, index, PART * limit[1]) for index in range(SPRINGS)]
        for power in range(DEGREE + 1):
            columns += [
                Column("elastic_cable", "joint", j, power, PART * limit[j]) for j in range(N_JOINTS)
            ]
        for effect in ("coulomb_friction", "viscous_friction"):
            for place in ("joint", "motor"):
                columns += [
                    Column(effect, place, j, 0, PART * limit[j], True) for j in range(N_JOINTS)
                ]
        columns += [
            Column("rotor_inertia", "motor", j, 0, 0.05 * limit[j], True) for j in range(N_JOINTS)
        ]
        for element in range(len(DISPLACEMENTS)):
            for place in ("joint", "motor"):
                columns += [
                    Column("presliding_hysteresis", place, j, element, PART * limit[j], True)
                    for j in range(N_JOINTS)
                ]
        if self.posture.links is not None:
            columns += [Column("joint_offset", "joint", j, 0, MISPLACED) for j in OFFSETS]
            columns += [Column("base_tilt", "", -1, axis, MISPLACED) for axis in range(2)]
        self.columns = tuple(columns)

    @cached_property
    def base(self) -> Array:
        """(90, b) from base combinations of unit prior size to the links' parameters."""
        return base_directions(self.mounted)

    @cached_property
    def scale(self) -> Array:
        """(p,) prior standard deviations."""
        return np.array([column.scale for column in self.columns])

    @cached_property
    def positive(self) -> NDArray[np.bool_]:
        """(p,) mask of the columns that must not be negative."""
        return np.array([column.positive for column in self.columns])

    def offers(self, column: Column) -> bool:
        """Tell whether a fit may use a column; the noise is judged by all of them."""
        return True

    def select(self, **wanted: object) -> list[int]:
        """Return the indices of the columns whose fields have the wanted values."""
        return [
            index
            for index, column in enumerate(self.columns)
            if all(getattr(column, key) == value for key, value in wanted.items())
        ]

    def same(self, chosen: Sequence[int], others: Columns) -> list[int]:
        """Return which of other columns are the chosen ones; of the rigid body it is all."""
        rigid = {i for i, one in enumerate(others.columns) if one.effect == "link_inertia"}
        keys = {_key(self.columns[i]) for i in chosen}
        named = {i for i, one in enumerate(others.columns) if _key(one) in keys}
        return sorted(rigid | named)

    def history(self, state: State, before: Array | None = None) -> Array:
        """Return (N, K, 2, 7) states of the presliding elements along a motion.

        Args:
            state: (N, 7) arrays, a whole motion or its continuation.
            before: (K, 2, 7) of its first sample, if it continues one.
        """
        return self._presliding.elements(state, before)

    def regressor(self, state: State, history: Array, stride: int = 1) -> Array:
        """Return (N, 7, p) torques *at the motors* of all columns.

        Args:
            state: (N, 7) arrays, part of a motion.
            history: (N, K, 2, 7), the same part of :meth:`history`.
            stride: Samples over which the motion is smooth: the posture's slopes, dear and as
                smooth as it is, are evaluated so far apart, with cubic splines between.
        """
        arm, measured = self.mounted, state
        state = self.posture.true(measured)
        rigid = rigid_body.regressor(arm, state.q, state.qd, state.qdd, arm.gravity)
        parts = [rigid @ self.base, gravity.regressor(state.q, arm.gravity)[..., :SPRINGS]]
        for term in self._terms:
            if isinstance(term, PreslidingHysteresis):
                part = term.columns(history)
            else:
                part = term.regressor(state)
            if isinstance(term, ElasticCable):
                part = part @ self._legendre
            elif isinstance(term, CoulombFriction):
                # The same upwards and downwards: a difference is a constant, which is a column.
                part = np.concatenate(
                    [part[..., :7] + part[..., 7:14], part[..., 14:21] + part[..., 21:]], axis=-1
                )
            parts.append(part)
        if self.posture.links is not None:
            parts.append(self._slopes(measured, stride))
        return np.matmul(arm.actuator_to_joint.T, np.concatenate(parts, axis=-1))

    def _slopes(self, measured: State, stride: int) -> Array:
        from scipy.interpolate import CubicSpline

        last = len(measured.q) - 1
        if stride == 1 or last < stride:
            return self.posture.slopes(self.arm, measured)
        knots = np.unique(np.append(np.arange(0, last, stride), last))
        at_knots = self.posture.slopes(self.arm, measured.rows(knots))
        return np.asarray(CubicSpline(knots, at_knots)(np.arange(last + 1)))

    @cached_property
    def _legendre(self) -> Array:
        """(k, k) from Legendre polynomials over the range to powers, joint by joint."""
        matrix = np.zeros((DEGREE + 1, N_JOINTS, DEGREE + 1, N_JOINTS))
        for j, (low, high) in enumerate(zip(self.valid.lower, self.valid.upper, strict=True)):
            domain = (low, high) if high - low > 1e-3 else (low - 1.0, low + 1.0)
            for power in range(DEGREE + 1):
                one = np.polynomial.Legendre.basis(power, domain=domain)
                powers = one.convert(kind=np.polynomial.Polynomial).coef
                matrix[: len(powers), j, power, j] = powers
        size = (DEGREE + 1) * N_JOINTS
        return matrix.reshape(size, size)

    def powers(self, joint: int) -> Array:
        """Return (degree + 1, degree + 1): a joint's powers from its Legendre polynomials."""
        return self._legendre[joint::N_JOINTS, joint::N_JOINTS]

    def corrected(self, theta: Array) -> Posture:
        """Return the posture that (p,) coefficients ask for, with their links for its slopes."""
        rigid = self.base.shape[1]
        offset, tilt = self.posture.offset.copy(), self.posture.tilt.copy()
        for column, value in zip(self.columns, theta.tolist(), strict=True):
            if column.effect == "joint_offset":
                offset[column.joint] += value
            elif column.effect == "base_tilt":
                tilt[column.index] += value
        return Posture(offset, tilt, self.base @ theta[:rigid], theta[rigid : rigid + SPRINGS])

    def terms(self, theta: Array, links: Array | None = None) -> tuple[Term, ...]:
        """Return the model's terms for (p,) coefficients; those that are zero are left out.

        Args:
            theta: The coefficients.
            links: (90,) link parameters to use for those of the base combinations.
        """
        from dvrk_gravity.effects import Gravity

        rigid = theta[: self.base.shape[1]]
        springs = theta[len(rigid) : len(rigid) + SPRINGS]
        built: list[Term] = []
        if links is None:
            links = self.base @ rigid
        if links.any() or springs.any():
            beta = beta_map(self.mounted) @ links
            beta[:SPRINGS] += springs
            built.append(Gravity(self.arm, beta, self.mounted.gravity))
            zero = LinkInertia(self.arm, np.zeros((len(TREE_LINKS), rigid_body.PER_LINK)))
            built.append(zero.with_theta(links))
        start = len(rigid) + SPRINGS
        for term in self._terms:
            count = len(term.theta)
            if isinstance(term, CoulombFriction):
                joint, motor = theta[start : start + 7], theta[start + 7 : start + 14]
                value, count = np.concatenate([joint, joint, motor, motor]), 14
            else:
                value = theta[start : start + count]
            start += count
            if not value.any():
                continue
            if isinstance(term, ElasticCable):
                value = self._trimmed(self._legendre @ value)
            if isinstance(term, PreslidingHysteresis):
                built.append(_without_idle(term.with_theta(value)))
            else:
                built.append(term.with_theta(value))
        return tuple(built)

    @staticmethod
    def _trimmed(powers: Array) -> Array:
        rows = powers.reshape(-1, N_JOINTS)
        return rows[: int(np.flatnonzero(rows.any(axis=1)).max()) + 1].ravel()


def _without_idle(term: PreslidingHysteresis) -> PreslidingHysteresis:
    """Return the term without the elements that no joint uses."""
    used = term.joint.any(axis=1) | term.motor.any(axis=1)
    return PreslidingHysteresis(
        term.arm, term.displacement[used], term.joint[used], term.motor[used]
    )
