"""Torque that follows acceleration and velocity products: the links' inertia."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from dvrk_gravity.arms import Arm, rigid_body
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects.base.arrays import Values, as_value
from dvrk_gravity.effects.base.effect import Hypothesis
from dvrk_gravity.effects.base.linear_term import LinearTerm
from dvrk_gravity.effects.base.links import AXES, inertia_directions, prior_scale
from dvrk_gravity.effects.base.meaning import MORE, Estimate, Words, meanings, size
from dvrk_gravity.effects.base.motion import Motion, State
from dvrk_gravity.effects.base.site import THE_ARM, Site, joints_with_weight, links_of_joints
from dvrk_gravity.effects.base.term import PlantPart
from dvrk_gravity.errors import ShapeError
from dvrk_gravity.parameters import Parameter, Value

_WEIGHTLESS = np.zeros(3)


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
    REMEDY = "see whether something was fastened to the links or taken off them"
    MEANINGS = meanings(
        inertia=size("kg·m^2", MORE),
        **{f"inertia_{axis}{axis}": size("kg·m^2", MORE) for axis in AXES},
    )
    INERTIA_OF_ARM = True
    COMPENSATED = False  # a compensator holds; it knows no acceleration

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
    def stated(cls, arm: Arm) -> LinkInertia | None:
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

    @property
    def theta(self) -> Array:
        return self.links.ravel()

    def with_theta(self, theta: Array) -> LinkInertia:
        return replace(self, links=np.reshape(theta, self.links.shape))

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
        return inertia_directions(self.arm, self.site.index, self.isotropic)

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
        return motion.inertial_torque(motion.inertial)

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
    return {**values, name: tuple(row.tolist())}


def with_inertia(values: Values, body: str, change: Array) -> Values:
    """Return a model's parameters with (10,) more of a body, if the model has inertia at all."""
    if not any(name.startswith(f"{LinkInertia.NAME}.") for name in values):
        return values
    return _with_change(values, body, change)
