"""Elastic torque of a joint's own position: cable bundle, spring, counterbalance."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.polynomial import Chebyshev, Polynomial

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects.base.arrays import (
    Values,
    as_array,
    as_value,
    diagonal_columns,
    position_offset,
    write_rows,
)
from dvrk_gravity.effects.base.column import PRIOR_FRACTION, ColumnTable, SearchMove, site_columns
from dvrk_gravity.effects.base.effect import Hypothesis, spread
from dvrk_gravity.effects.base.joint_dynamics import JointDynamics
from dvrk_gravity.effects.base.linear_term import LinearTerm, Unknowns
from dvrk_gravity.effects.base.meaning import MORE, Estimate, Meaning, Words, meanings, size
from dvrk_gravity.effects.base.motion import Motion, State
from dvrk_gravity.effects.base.polynomials import (
    JointPolynomials,
    Range,
    declare_coefficients,
    declare_range,
    evaluate,
    legendre,
    prepare_polynomials,
    prepare_powers,
    read_coefficients,
)
from dvrk_gravity.effects.base.site import Kind, Site, effort_limits
from dvrk_gravity.effects.base.term import Evaluator, PlantPart
from dvrk_gravity.parameters import Parameter, Value

DEGREE = 7  # highest power of a joint's own position that identification tries
_DEGREES = (1, 2, 3, 4, 6)
_REACH = 1.1  # times half the way, beyond which a polynomial is held
_FAR = 1e6  # rad, of an edge that is none
# Of half the way, from which on two poses are two positions of a joint. Chosen: a motion has fifty,
# a grid of poses as many as it has steps.
_APART = 0.04


@dataclass(frozen=True, eq=False)
class ElasticCable(LinearTerm):
    """tau_j = k0 + k1 q_j + k2 q_j^2 + …, q_j held at the edges of the fitted range.

    Attributes:
        arm: The arm, for its joints' names.
        coefficients: (degree + 1, n), lowest power first, N·m/rad^k.
        valid: Range of positions on which they were fitted.
    """

    NAME = "elastic_cable"
    IN_FILES = ("console",)
    COEFFICIENTS = ("coefficients",)
    REMEDY = "look at the cables and springs across {joint}"
    AT_POSES = True
    MEANINGS = meanings(
        stiffness=size("N·m/rad", MORE),
        lowest=Meaning("N·m", 0.0, label="least torque", certain=True),
        highest=Meaning("N·m", 0.0, label="greatest torque", certain=True),
    )

    arm: Arm
    coefficients: Array
    valid: Range

    @classmethod
    def constant(cls, arm: Arm, torque: Array) -> ElasticCable:
        """Return cables of (n,) constant torque, N·m."""
        return cls(arm, torque[None], Range(np.full(arm.n, -np.inf), np.full(arm.n, np.inf)))

    @classmethod
    def drawn(cls, arm: Arm, random: np.random.Generator, part: float) -> ElasticCable:
        """Polynomials of degree three of each joint's position, from -1 to 1 over its range."""
        lowest, highest = (np.clip(end, -2.0 * np.pi, 2.0 * np.pi) for end in arm.range)
        coefficients = part * arm.effort_limit * random.uniform(-1.0, 1.0, (4, arm.n))
        rows = [
            np.polynomial.Polynomial(each, [low, high], [-1.0, 1.0]).convert().coef
            for each, low, high in zip(coefficients.T, lowest, highest, strict=True)
        ]
        ends = Range(np.full(arm.n, -np.inf), np.full(arm.n, np.inf))
        return cls(arm, np.array(rows, dtype=float).T, ends)

    @classmethod
    def schema(cls, arm: Arm) -> tuple[Parameter, ...]:
        return (
            *declare_coefficients(arm, cls.NAME, "elastic torque k0, k1, …"),
            *declare_range(arm, cls.NAME),
        )

    @classmethod
    def from_parameters(cls, arm: Arm, values: Mapping[str, Value]) -> ElasticCable | None:
        coefficients = read_coefficients(arm, cls.NAME, values)
        if coefficients is None:
            return None
        return cls(arm, coefficients, Range.from_parameters(arm, cls.NAME, values))

    def parameters(self) -> dict[str, Value]:
        coefficients = write_rows(self.arm, self.NAME, self.coefficients)
        return coefficients | self.valid.parameters(self.NAME)

    @property
    def polynomials(self) -> JointPolynomials:
        return JointPolynomials(self.coefficients, self.coefficients, self.valid)

    def torque(self, state: State) -> Array:
        return evaluate(self.coefficients, self.valid.hold(state.q))

    @classmethod
    def meaning(cls, name: str) -> Meaning:
        if name.startswith("k"):
            unit = "N·m" if name == "k0" else f"N·m/rad^{name[1:]}"
            return Meaning(unit)
        return super().meaning(name)

    @classmethod
    def listed(cls, names: Iterable[str]) -> list[str]:
        """No coefficients, and of a curve not the slope in its middle."""
        sizes = [name for name in names if not name.startswith("k")]
        return [name for name in sizes if name != "stiffness" or "lowest" not in sizes]

    @classmethod
    def hypotheses(cls, motion: Motion) -> Iterator[Hypothesis]:
        middle, half = motion.travel
        for joint in np.flatnonzero(motion.moves).tolist():
            # As many positions as coefficients: between them more are not determined.
            known = _positions(motion.q[:, joint], _APART * half[joint])
            for degree in (each for each in _DEGREES if each < known):
                yield CableHypothesis(
                    arm=motion.arm, site=Site.joint(joint),
                    form=f"degree {degree}", degree=degree,
                    middle=float(middle[joint]), half=float(half[joint]),
                )  # fmt: skip

    @classmethod
    def history_hypotheses(cls, motion: Motion) -> Iterator[Hypothesis]:
        """Of each joint that moves, its stiffness."""
        return (each for each in cls.hypotheses(motion) if each.form == "degree 1")

    def prepare(self) -> Evaluator:
        coefficients = self.coefficients
        powers = prepare_powers(self.valid, len(coefficients))
        sum_up = np.ones(len(coefficients)).dot
        return lambda q, qd: sum_up(coefficients * powers(q))

    def joint_dynamics(self, arm: Arm, q: Array) -> JointDynamics:
        """The straight lines nearest to the torque at these positions."""
        torque, held = self.torque(State(q)), self.valid.hold(q)
        lines = np.zeros((2, arm.n))
        for joint, powers in enumerate(self.coefficients.T):
            if powers[2:].any() or (held[:, joint] != q[:, joint]).any():
                lines[:, joint] = np.polynomial.polynomial.polyfit(q[:, joint], torque[:, joint], 1)
            else:
                lines[: len(powers), joint] = powers[:2]
        omits = "its curvature: the file has the nearest straight line"
        return JointDynamics(arm, constant=lines[0], stiffness=lines[1], omits=omits)

    def plant(self) -> PlantPart:
        values = prepare_polynomials(self.valid, self.coefficients)
        return PlantPart(at=lambda q, qd: (values(q), None))

    @classmethod
    def moves(cls, table: ColumnTable, inside: set[int]) -> Iterator[SearchMove]:
        """Polynomials of higher degree, and of one degree less.

        A cubic may help where neither a slope nor a parabola does.
        """
        for joint, name in enumerate(table.arm.joint_names):
            powers = table.select(cls.NAME, Site.joint(joint))
            degree = max((k for k in range(DEGREE + 1) if powers[k] in inside), default=-1)
            for higher in range(degree + 1, min(degree + 4, DEGREE + 1)):
                come = tuple(powers[degree + 1 : higher + 1])
                yield SearchMove(come, (), f"{cls.NAME} {name}, degree {higher}")
            if degree > 0:
                yield SearchMove(
                    (), (powers[degree],), f"{cls.NAME} {name}, degree {degree - 1} only"
                )
            elif degree == 0:
                yield SearchMove((), (powers[0],), f"without a constant torque on {name}")

    @classmethod
    def minimal_columns(cls, table: ColumnTable) -> list[int]:
        return table.select(cls.NAME, index=0)

    @classmethod
    def unknowns(cls, arm: Arm, valid: Range) -> Unknowns:
        """Legendre polynomials over the range, which are well conditioned."""
        scale = PRIOR_FRACTION * effort_limits(arm, Kind.JOINT)
        columns = [
            column
            for power in range(DEGREE + 1)
            for column in site_columns(cls.NAME, Kind.JOINT, scale, power, False, "")
        ]
        term = cls(arm, np.zeros((DEGREE + 1, arm.n)), valid)
        return Unknowns(term, tuple(columns), legendre(valid, DEGREE))

    def reduced(self) -> ElasticCable:
        used = np.flatnonzero(self.coefficients.any(axis=1)).tolist()
        return replace(self, coefficients=self.coefficients[: max(used, default=0) + 1])

    def regressor(self, state: State) -> Array:
        held = self.valid.hold(state.q)
        powers = [held**k for k in range(len(self.coefficients))]
        return np.concatenate([diagonal_columns(power) for power in powers], axis=-1)


@dataclass(frozen=True, eq=False, kw_only=True)
class CableHypothesis(Hypothesis):
    """A polynomial of a joint's position; its constant is where the spring is relaxed.

    Attributes:
        degree: Of the polynomial.
        middle: Middle of the joint's way, rad.
        half: Half of it, rad.
        reach: Times that, beyond which a curve is held.
    """

    EFFECT = ElasticCable
    EXPLAINED_BY = "payload"
    CLAIM = "{joint} has {stiffness} stiffness than {model}"

    degree: int
    middle: float
    half: float
    reach: float = _REACH

    @property
    def extrapolated(self) -> CableHypothesis:
        """A curve, too, may go on."""
        return replace(self, reach=np.inf)

    def regressor(self, motion: Motion) -> Array:
        """Chebyshev polynomials are the same space as powers, and well conditioned.

        A curve says nothing beyond the way that it was fitted on; a spring goes on.
        """
        x = (motion.q[:, self.site.index] - self.middle) / self.half
        if self.degree > 1:
            x = np.clip(x, -self.reach, self.reach)
        values = np.polynomial.chebyshev.chebvander(x, self.degree)
        return spread(self.site.row(self.arm), *values.T)

    def _polynomial(self, theta: Array) -> Chebyshev:
        return Chebyshev(theta, [self.middle - self.half, self.middle + self.half])

    def _powers(self, theta: Array) -> Array:
        powers = self._polynomial(theta).convert(kind=Polynomial).coef
        return np.pad(powers, (0, self.degree + 1 - len(powers)))

    def parameters(self, theta: Array) -> dict[str, float]:
        scaled = self._polynomial(theta)
        values = {f"k{i}": float(value) for i, value in enumerate(self._powers(theta))}
        values = {"stiffness": float(scaled.deriv()(self.middle))} | values
        if self.degree == 1:
            return values
        # One slope says little of a curve: between what it pulls, over the way.
        way = scaled(np.linspace(self.middle - self.half, self.middle + self.half, 101))
        return {"lowest": float(way.min()), "highest": float(way.max())} | values

    def merge(self, values: Values, theta: Array, motion: Motion) -> Values:
        """A curve is held at the edges of the motion.

        A curve that the model has already is held where it was fitted, and so is the sum.
        """
        joint, name = self.site.index, f"{self.effect}.{self.arm.joint_names[self.site.index]}"
        offset = float(position_offset(self.arm, values)[joint])
        # Of the true position.
        shifted = Polynomial(self._powers(theta))(Polynomial([offset, 1.0]))
        powers = np.asarray(shifted.coef, dtype=np.float64)
        known = np.array(values.get(name) or (0.0,))
        total = np.zeros(max(len(known), len(powers)))
        total[: len(known)] += known
        total[: len(powers)] += powers
        result = {**values, name: as_value(total)}
        middle, half = motion.travel
        for edge, default, sign in (("valid_lower", -_FAR, -1.0), ("valid_upper", _FAR, 1.0)):
            field = f"{self.effect}.{edge}"
            if self.degree < 2 and not values.get(field):
                continue
            limits = as_array(values.get(field), self.arm.n, default)
            free = not known[1:].any()  # a constant is the same wherever it is held
            if self.degree < 2:
                limits[joint] = default if free else limits[joint]
            elif free or abs(limits[joint]) >= _FAR:
                limits[joint] = middle[joint] + sign * half[joint] - offset
            result[field] = as_value(limits)
        return result

    def _claim(self, parameters: Mapping[str, Estimate], words: Words) -> str:
        if "lowest" not in parameters:
            return super()._claim(parameters, words)
        return (
            f"{self.names[0]} has an elastic torque in addition to {self.against}'s, between "
            f"{words['lowest']} and {words['highest']} over its range"
        )


def _positions(q: Array, apart: float) -> int:
    """Return how many of (N,) positions lie so far apart, rad or m."""
    ascending, count, first = np.sort(q), 0, 0
    while first < len(q):
        count += 1
        first = int(np.searchsorted(ascending, ascending[first] + apart, side="right"))
    return count
