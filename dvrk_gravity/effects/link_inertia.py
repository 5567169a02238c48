"""Torque that follows acceleration and velocity products: the links' inertia."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from dvrk_gravity import gravity
from dvrk_gravity.arms import Arm, build_tree, is_mtm, rigid_body
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects.base.arrays import Values, as_value
from dvrk_gravity.effects.base.column import PRIOR_FRACTION, Column, ColumnTable
from dvrk_gravity.effects.base.effect import Hypothesis
from dvrk_gravity.effects.base.linear_term import LinearTerm
from dvrk_gravity.effects.base.links import AXES, base_directions, prior_scale
from dvrk_gravity.effects.base.meaning import MORE, Estimate, Words, meanings, size
from dvrk_gravity.effects.base.motion import Motion, State
from dvrk_gravity.effects.base.site import THE_ARM, Site, joints_with_weight, links_of_joints
from dvrk_gravity.effects.base.term import Evaluator, PlantPart, Term
from dvrk_gravity.effects.gravity import Gravity
from dvrk_gravity.effects.link_weight import LinkWeight, weight_of
from dvrk_gravity.errors import ShapeError
from dvrk_gravity.parameters import Parameter, Value

_WEIGHTLESS = np.zeros(3)
SPRINGS = 4  # entries of an MTM's beta, arm and forearm, that a balancing spring can add to


@dataclass(frozen=True, eq=False)
class LinkInertia(LinearTerm):
    """tau = M(q) qdd + C(q, qd) qd of the links; their weight is the gravity term's.

    Only combinations of the parameters act (42 of the 90 of an MTM). Identified ones are those of
    physical bodies unless ``--no-physical`` was given; other models' need not be.

    Attributes:
        arm: The arm.
        links: (bodies, 10), one row a body of the arm, in its joint's frame, in Pinocchio's
            order: m kg, m c (3) kg·m, Ixx, Ixy, Iyy, Ixz, Iyz, Izz kg·m^2 about the origin.
    """

    NAME = "link_inertia"
    COEFFICIENTS = ("links",)
    REMEDY = "see whether something was fastened to the links or taken off them"
    MEANINGS = meanings(
        inertia=size("kg·m^2", MORE),
        **{f"inertia_{axis}{axis}": size("kg·m^2", MORE) for axis in AXES},
    )
    COMPENSATED = False  # a compensator holds; it knows no acceleration
    OF_LINKS = rigid_body.PER_LINK

    arm: Arm
    links: Array

    @classmethod
    def schema(cls, arm: Arm) -> tuple[Parameter, ...]:
        return tuple(
            Parameter(
                f"{cls.NAME}.{body}",
                (),
                "kg, kg·m, kg·m^2",
                f"{body} in its joint's frame: m, m c (3), Ixx, Ixy, Iyy, Ixz, Iyz, Izz",
                lengths=(rigid_body.PER_LINK,),
            )
            for body in arm.body_names
        )

    @classmethod
    def from_parameters(cls, arm: Arm, values: Mapping[str, Value]) -> LinkInertia | None:
        given = [values.get(f"{cls.NAME}.{body}") for body in arm.body_names]
        if not any(given):
            return None
        nothing = np.zeros(rigid_body.PER_LINK)
        return cls(arm, np.array([np.array(row) if row else nothing for row in given]))

    @classmethod
    def from_arm(cls, arm: Arm) -> LinkInertia | None:
        rows = arm.inertial_parameters
        return None if rows is None else cls(arm, rows)

    def parameters(self) -> dict[str, Value]:
        return {
            f"{self.NAME}.{body}": as_value(row)
            for body, row in zip(self.arm.body_names, self.links, strict=True)
        }

    def torque(self, state: State) -> Array:
        """Return (…, n) torques, N·m; zero where no motion is known."""
        if state.qd is None and state.qdd is None:
            return np.zeros(state.q.shape)
        motion = (state.q, state.qd, state.qdd)
        return rigid_body.torque(self.arm, self.theta, *motion, _WEIGHTLESS)

    def prepare(self) -> Evaluator:
        tree, theta, still = build_tree(self.arm, {}, _WEIGHTLESS), self.theta, np.zeros(self.arm.n)

        def evaluate(q: Array, qd: Array | None) -> Array:
            return np.zeros(len(q)) if qd is None else tree.regressor(q, qd, still).dot(theta)

        return evaluate

    def momentum(self, q: Array, qd: Array) -> tuple[Array, Array]:
        return rigid_body.momentum(self.arm, self.theta, q, qd)

    @classmethod
    def hypotheses(cls, motion: Motion) -> Iterator[Hypothesis]:
        if motion.static or not motion.present.all():
            return
        for joint in joints_with_weight(motion.arm):
            link = links_of_joints(motion.arm)[joint]
            for form, isotropic in (("isotropic", True), ("principal", False)):
                yield InertiaHypothesis(
                    arm=motion.arm, site=Site.link(link), joints=(joint,),
                    form=f"{motion.arm.body_names[link]} {form}", isotropic=isotropic,
                )  # fmt: skip
        yield AllInertiaHypothesis(
            arm=motion.arm, site=THE_ARM, form="inertia of all links",
            prior_std=tuple(prior_scale(motion.arm)[motion.inertial].tolist()),
        )  # fmt: skip

    @property
    def inertial_parameters(self) -> Array:
        return self.links

    def plant(self) -> PlantPart:
        """Nothing: the plant's bodies have it."""
        return PlantPart()

    def regressor(self, state: State) -> Array:
        if state.q.ndim != 2:
            raise ShapeError("q", state.q.shape, "(N, n)")
        return rigid_body.regressor(self.arm, state.q, state.qd, state.qdd, _WEIGHTLESS)


@dataclass(frozen=True, eq=False, kw_only=True)
class InertiaHypothesis(Hypothesis):
    """A link's rotational inertia is wrong.

    Attributes:
        isotropic: The same about all axes, or one about each axis of the link's frame.
    """

    EFFECT = LinkInertia

    isotropic: bool
    variable = "acceleration"

    @property
    def _directions(self) -> Array:
        """(10, k) inertial parameters per kg·m^2 of rotational inertia."""
        rotation = self.arm.bodies[self.site.index].frame.rotation
        directions = []
        for tensor in [np.eye(3)] if self.isotropic else map(np.diag, np.eye(3)):
            turned = rotation @ tensor @ rotation.T
            xx, xy, xz, yy, yz, zz = turned[np.triu_indices(3)]
            directions.append([0.0, 0.0, 0.0, 0.0, xx, xy, yy, xz, yz, zz])
        return np.array(directions).T

    def regressor(self, motion: Motion) -> Array:
        return motion.link_torque(self.site.index, self._directions)

    def parameters(self, theta: Array) -> dict[str, float]:
        if self.isotropic:
            return {"inertia": float(theta[0])}
        return {f"inertia_{a}{a}": float(t) for a, t in zip(AXES, theta, strict=True)}

    def merge(self, values: Values, theta: Array, motion: Motion) -> Values:
        return _with_change(values, self.arm.body_names[self.site.index], self._directions @ theta)

    def _claim(self, parameters: Mapping[str, Estimate], words: Words) -> str:
        joint = self.names[0]
        if self.isotropic:
            return f"the link of {joint} has {words['inertia']} inertia than {self.against}'s"
        about = ", ".join(f"{words[name]} about {name[-1]}" for name in parameters)
        return f"the inertia of {joint}'s link differs from {self.against}'s: {about}"


@dataclass(frozen=True, eq=False, kw_only=True)
class AllInertiaHypothesis(Hypothesis):
    """The links' inertia as a whole is another one, or missing.

    Its many coefficients mean nothing one by one.
    """

    EFFECT = LinkInertia
    CLAIM = "the links' inertias as a whole differ from {model}'s"

    variable = "acceleration"
    refits_model = True

    def regressor(self, motion: Motion) -> Array:
        return motion.inertial_torque()

    def parameters(self, theta: Array) -> dict[str, float]:
        return {}

    def merge(self, values: Values, theta: Array, motion: Motion) -> Values:
        change = np.zeros(rigid_body.PER_LINK * len(self.arm.bodies))
        change[motion.inertial] = theta
        for body, row in zip(
            self.arm.body_names, change.reshape(-1, rigid_body.PER_LINK), strict=True
        ):
            values = _with_change(values, body, row)
        return values


def _with_change(values: Values, body: str, change: Array) -> Values:
    name = f"{LinkInertia.NAME}.{body}"
    row = np.array(values.get(name) or np.zeros(rigid_body.PER_LINK)) + change
    return {**values, name: as_value(row)}


def with_inertia(values: Values, body: str, change: Array) -> Values:
    """Return a model's parameters with (10,) more of a body, if the model has inertia at all."""
    if not any(name.startswith(f"{LinkInertia.NAME}.") for name in values):
        return values
    return _with_change(values, body, change)


def link_columns(table: ColumnTable) -> list[int]:
    """Return the indices of the links' columns."""
    return table.select(LinkInertia.NAME)


def spring_columns(table: ColumnTable) -> list[int]:
    """Return the indices of the columns of springs that balance links."""
    return table.select(Gravity.NAME)


class RigidColumns:
    """Columns of the links' base parameters, then of springs.

    Weight and inertia share the links' parameters, so that what is identified is a set of base
    parameters. An MTM's weight is beta, a function of them; a spring that balances its arm or
    forearm pulls like a mass and has no inertia: it is a column of gravity alone.

    Class attributes:
        EFFECTS: Names of the effects that they are, which are always fitted.

    Attributes:
        arm: The arm, its base as it is mounted.
        base: (10 bodies, b) from base combinations of unit prior size to the links' parameters.
    """

    EFFECTS: ClassVar = (LinkInertia.NAME, Gravity.NAME, LinkWeight.NAME)

    def __init__(self, arm: Arm, absent: tuple[int, ...] = ()) -> None:
        """Find the combinations, with the ``absent`` of the links' parameters zero."""
        self.arm = arm
        self.base = base_directions(arm, absent)
        self._springs = SPRINGS if is_mtm(arm) else 0

    @cached_property
    def columns(self) -> tuple[Column, ...]:
        """The columns, in order."""
        inertia, weight, _ = self.EFFECTS
        spring = PRIOR_FRACTION * float(self.arm.actuator_effort_limit[1]) if self._springs else 0.0
        return (
            *(Column(inertia, THE_ARM, index, 1.0) for index in range(self.base.shape[1])),
            *(Column(weight, THE_ARM, index, spring) for index in range(self._springs)),
        )

    @property
    def springs(self) -> tuple[Column, ...]:
        """Those of springs."""
        return self.columns[self.base.shape[1] :]

    def regressor(self, state: State) -> Array:
        """Return (N, n, p) joint torques of all columns at (N, n) true states."""
        arm = self.arm
        links = rigid_body.regressor(arm, state.q, state.qd, state.qdd, arm.gravity)
        if not self._springs:
            return links @ self.base
        springs = gravity.regressor(state.q, arm.gravity)[..., : self._springs]
        return np.concatenate([links @ self.base, springs], axis=-1)

    def bodies(self, theta: Array) -> tuple[Array, Array]:
        """Return (10 bodies,) link parameters and springs, N·m, of (p,) coefficients."""
        own, springs = np.split(theta, [self.base.shape[1]])
        return self.base @ own, springs

    def terms(self, arm: Arm, theta: Array, links: Array | None) -> list[Term]:
        """Return the terms of an arm's model; see :meth:`Columns.terms`."""
        own, springs = self.bodies(theta)
        links = own if links is None else links
        if not links.any() and not springs.any():
            return []
        bodies = links.reshape(-1, rigid_body.PER_LINK)
        weight = weight_of(arm, bodies, self.arm)
        balanced = weight.theta + np.pad(springs, (0, len(weight.theta) - len(springs)))
        return [weight.with_theta(balanced), LinkInertia(arm, bodies)]
