"""A mass carried by a link: a tool, a clip, a gripper."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import numpy as np
import pinocchio as pin

from dvrk_gravity.arms import GRAVITY, Arm, Tree, build_tree, rigid_body
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects.base.arrays import Values, as_value
from dvrk_gravity.effects.base.effect import Hypothesis
from dvrk_gravity.effects.base.links import (
    AXES,
    gravity_of,
    identifiable_links,
    link_sizes,
    mass_directions,
    weight_evaluator,
)
from dvrk_gravity.effects.base.meaning import Estimate, Meaning, Words, meanings
from dvrk_gravity.effects.base.motion import Motion, State
from dvrk_gravity.effects.base.site import Site, last_link, links_of_joints
from dvrk_gravity.effects.base.term import Evaluator, PlantPart, Term
from dvrk_gravity.effects.link_com import with_link
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.parameters import Parameter, Value

_WEIGHTLESS = np.zeros(3)


_LEAST = 1e-4  # kg, of which the place can be found
_HEAVY, _AWAY = 5.0, 1.0  # kg and m. Chosen
_FARTHEST = 1.0  # m, from the link's frame: no link of these arms is longer
_ROUNDING = 1e-9
_AFAR = 2.0  # times what is likely, beyond which a load is not possible either. Chosen
_NEAR = 2.0  # times a link's extent: standard deviations of a load's place before any data
_REACH = 3.0  # m, of a place that is stated: a longer one is in other units. Chosen
_PLACED = 0.05  # m, half of a 95 % interval, within which a centre of mass is reported, ...
_PART_OF_WAY = 0.5  # ... or this part of its distance
_NO_TORQUE = 1e-6  # N·m or N, of 1 kg: rounding
_UNSEEN = 1e-6  # m, of an interval about 0 along a joint's axis, where a mass makes no torque


def heaviest(arm: Arm) -> float:
    """Return the mass, kg, that a link may carry: what the strongest joint holds a metre away.

    Not less than 5 kg, of an arm whose efforts are small or whose reach is.
    """
    turns = [joint.effort_limit for joint in arm.joints if joint.effort_unit != "N"]
    return max(_HEAVY, max(turns, default=0.0) / (GRAVITY * _AWAY))


@dataclass(frozen=True, eq=False)
class Payload(Term):
    """Weight and inertia of a point mass on a link.

    The compensator carries its weight; its inertia is predicted and simulated. Gravity's
    direction and flag are those of the gravity term, from the same parameters.

    Attributes:
        arm: The arm.
        link: The link that carries it, by name.
        mass: kg.
        first_moment: (3,) mass times its place in the link's frame, kg·m.
        vector: (3,) gravity in the base frame, m/s^2.
        weighs: The gravity flag.
    """

    NAME = "payload"
    REMEDY = "take off what the link carries"
    NOT_FITTED = "what a link carries is in the parameters of links, which are fitted anyway"
    MEANINGS = meanings(
        mass=Meaning("kg", 0.0, least=0.0),
        **{f"first_moment_{axis}": Meaning("kg·m") for axis in AXES},
        **{axis: Meaning("m", label=f"centre, {axis} of the link's frame") for axis in AXES},
    )

    arm: Arm
    link: str
    mass: float
    first_moment: Array
    vector: Array
    weighs: bool = True

    @classmethod
    def summary(cls, parameters: Mapping[str, Estimate]) -> str:
        return f"mass {cls.meaning('mass').in_words(parameters['mass'])}{_centre(parameters)}"

    @classmethod
    def schema(cls, arm: Arm) -> tuple[Parameter, ...]:
        return (
            Parameter(
                "payload.mass", 0.0, "kg", "mass carried by a link",
                lower=0.0, upper=2.0 * heaviest(arm), adjustable=True,
            ),
            Parameter(
                "payload.first_moment", (), "kg·m", "mass times its place in the link's frame",
                lower=-10.0, upper=10.0, lengths=(3,), adjustable=True,
            ),
            Parameter(
                "payload.link", last_link(arm), "", "link that carries it", choices=arm.body_names,
                adjustable=True,
            ),
        )  # fmt: skip

    @classmethod
    def from_parameters(cls, arm: Arm, values: Mapping[str, Value]) -> Payload | None:
        mass = values.get("payload.mass", 0.0)
        moment = np.array(values.get("payload.first_moment") or (0.0, 0.0, 0.0))
        assert isinstance(mass, float)
        if mass == 0.0:
            if moment.any():
                raise ConfigError("payload.mass", mass, "more than 0 kg beside a first moment")
            return None
        link = str(values.get("payload.link", last_link(arm)))
        return cls(arm, link, mass, moment, *gravity_of(arm, values))

    def parameters(self) -> dict[str, Value]:
        return {
            "payload.mass": self.mass,
            "payload.first_moment": as_value(self.first_moment),
            "payload.link": self.link,
            "gravity_vector": as_value(self.vector),
            "gravity_enabled": self.weighs,
        }

    def with_gravity(self, vector: Array) -> Payload:
        return replace(self, vector=vector)

    @property
    def gravity_vector(self) -> Array:
        return self.vector

    @property
    def inertia(self) -> pin.Inertia:
        """Inertia of the point mass, in the link's frame."""
        return pin.Inertia(self.mass, self.first_moment / self.mass, np.zeros((3, 3)))

    @cached_property
    def weight(self) -> Tree:
        """Tree whose gravity torques are the payload's."""
        gravity = self.vector if self.weighs else _WEIGHTLESS
        return build_tree(self.arm, {self.link: self.inertia}, gravity)

    @property
    def inertial_parameters(self) -> Array:
        return self._links.reshape(-1, rigid_body.PER_LINK)

    def prepare(self) -> Evaluator:
        return weight_evaluator(self.weight)

    def plant(self) -> PlantPart:
        weight = self.weight if self.weighs else None
        return PlantPart(weight=weight, links={self.link: self.inertia})

    def torque(self, state: State) -> Array:
        """Return (…, n) torques of weight and inertia, N·m; at rest where no motion is known."""
        motion = (state.q, state.qd, state.qdd)
        if state.q.ndim == 1:
            q, qd, qdd = (np.zeros(self.arm.n) if each is None else each for each in motion)
            return self.weight.inverse_dynamics(q, qd, qdd)
        gravity = self.vector if self.weighs else _WEIGHTLESS
        return rigid_body.torque(self.arm, self._links, *motion, gravity)

    @classmethod
    def monitor_hypotheses(cls, motion: Motion) -> Iterator[Hypothesis]:
        """On any link, wherever on it: who fastens something does not say where."""
        return cls.hypotheses(motion)

    def momentum(self, q: Array, qd: Array) -> tuple[Array, Array]:
        return rigid_body.momentum(self.arm, self._links, q, qd)

    @classmethod
    def hypotheses(cls, motion: Motion) -> Iterator[Hypothesis]:
        if not motion.present.all():
            return
        if motion.payload_at is not None:
            link, place = motion.payload_at
            yield PlacedPayloadHypothesis(
                arm=motion.arm, site=Site.link(link), form=motion.arm.body_names[link],
                setting=dict(zip(AXES, place.tolist(), strict=True)),
            )  # fmt: skip
            return
        for link in identifiable_links(motion.arm):
            yield PayloadHypothesis(
                arm=motion.arm, site=Site.link(link),
                form=motion.arm.body_names[link], setting=dict.fromkeys(AXES, 0.0),
            )  # fmt: skip

    @classmethod
    def unit_changes(cls, motion: Motion) -> Iterator[tuple[Hypothesis, Array]]:
        """At the end of the last link whose load shows, or where a load is stated to be."""
        *_, last = (None, *cls.hypotheses(motion))
        if not isinstance(last, PayloadHypothesis):
            return
        if motion.payload_at is None:
            place = _attachment_point(motion.arm, last.site.index).tolist()
            last = replace(last, setting=dict(zip(AXES, place, strict=True)))
            yield last, np.array([1.0, *place])
        else:
            yield last, np.ones(1)

    @classmethod
    def history_hypotheses(cls, motion: Motion) -> Iterator[Hypothesis]:
        """The mass at the end of the last link whose load shows: its place is a convention."""
        *_, last = (None, *cls.hypotheses(motion))
        if isinstance(last, PlacedPayloadHypothesis):
            yield last
        elif isinstance(last, PayloadHypothesis):
            place = _attachment_point(motion.arm, last.site.index).tolist()
            yield PlacedPayloadHypothesis(
                arm=motion.arm, site=last.site, form=last.form,
                setting=dict(zip(AXES, place, strict=True)),
            )  # fmt: skip

    @cached_property
    def _links(self) -> Array:
        """(10 bodies,) inertial parameters of the arm's bodies."""
        rows = np.zeros((len(self.arm.bodies), rigid_body.PER_LINK))
        body = self.arm.body(self.link).frame.act(self.inertia)
        rows[self.arm.body_names.index(self.link)] = body.toDynamicParameters()
        return rows.ravel()


@dataclass(frozen=True, eq=False, kw_only=True)
class PayloadHypothesis(Hypothesis):
    """A link carries a point mass that {model} does not know; a reference may have had more."""

    EFFECT = Payload
    CLAIM = "{where} carries {mass} that {model} does not know"

    fixed_point: ClassVar[tuple[str, ...]] = AXES
    refine_first = True  # a link may turn about its frame's origin, where a mass is nothing

    @property
    def _place(self) -> Array:
        return np.array([self.setting[axis] for axis in AXES])

    @property
    def _typical_distance(self) -> float:
        """How far from the link's frame a load is likely to be, m."""
        _, extent = link_sizes(self.arm)[self.site.index]
        return _NEAR * extent

    @property
    def _largest_distance(self) -> float:
        """How far from it one is possible, m."""
        return max(_FARTHEST, _AFAR * self._typical_distance)

    @property
    def _basis(self) -> Array:
        """(4, k) mass and first moment, kg and kg·m, by the k parameters."""
        return np.eye(4)

    def _directions(self) -> Array:
        return mass_directions(self.arm, self.site.index, self._place) @ self._basis

    def regressor(self, motion: Motion) -> Array:
        return motion.link_torque(self.site.index, self._directions())

    def parameters(self, theta: Array) -> dict[str, float]:
        mass, *moment = (self._basis @ theta).tolist()
        moments = {f"first_moment_{a}": m for a, m in zip(AXES, moment, strict=True)}
        # Of a mass that is not known yet (about the axis it turns about, say) the moment still
        # shows which way it is: the search comes in from afar.
        com = np.array(moment) / max(abs(mass), _LEAST)
        if self.against_reference and mass < 0.0:
            com = -com
        com *= min(1.0, _FARTHEST / max(float(np.linalg.norm(com)), _LEAST))
        return {"mass": mass, **moments} | {a: float(p) for a, p in zip(AXES, com, strict=True)}

    def _claim(self, parameters: Mapping[str, Estimate], words: Words) -> str:
        where = _centre(parameters)
        mass = parameters["mass"]
        if mass.value >= 0.0:
            return super()._claim(parameters, words) + where
        link = self.site.words(self.arm)
        return f"{link} carries {mass.magnitude.shown} less than in {self.against}{where}"

    def remedy(self, carried: bool) -> str:
        same = "let the link carry what it did, or go by this if it is meant to"
        return same if self.against_reference else super().remedy(carried)

    def plausible(self, theta: Array) -> bool:
        """Against a reference a mass may have been removed."""
        mass, *moment = self._basis @ theta
        if abs(mass) > heaviest(self.arm) or np.linalg.norm(moment) > self._largest_distance * abs(
            mass
        ):
            return False
        taken_off = self.against_reference and mass < 0.0
        return super().plausible(-theta if taken_off else theta)

    def typical(self, theta: Array) -> bool:
        """A first moment alone is a light mass farther away than what is fastened to a link."""
        mass, *moment = self._basis @ theta
        return bool(
            np.linalg.norm(moment) <= (1.0 + _ROUNDING) * self._typical_distance * abs(mass)
        )

    def clamped(self, theta: Array) -> Hypothesis | None:
        """It is where a load is still likely, if its best place is not possible."""
        moment = (self._basis @ theta)[1:]
        if not moment.any() or self.plausible(theta):
            return None
        place = self._typical_distance * moment / np.linalg.norm(moment)
        return FarPayloadHypothesis(
            arm=self.arm, site=self.site, form=self.form,
            setting=dict(zip(AXES, place.tolist(), strict=True)),
        )  # fmt: skip

    def merge(self, values: Values, theta: Array, motion: Motion) -> Values | None:
        """A second payload becomes part of the link."""
        link, name = self.arm.body_names[self.site.index], self.effect
        mass, *moment = (self._basis @ theta).tolist()
        if motion.model.term(name) is None and f"{name}.mass" not in values and mass > 0.0:
            named = {"mass": mass, "first_moment": tuple(moment), "link": link}
            return {**values, **{f"{name}.{key}": value for key, value in named.items()}}
        change = self._directions() @ theta
        return with_link(self.arm, values, self.site.index, change)


@dataclass(frozen=True, eq=False, kw_only=True)
class FarPayloadHypothesis(PayloadHypothesis):
    """A link carries a point mass as far away as one is likely: its mass is the one parameter.

    Where little inertia shows, the best fit is often a light mass far away. Whether a load explains
    as well then shows at the nearest place that is likely.
    """

    fixed_point = ()

    @property
    def _basis(self) -> Array:
        return np.array([[1.0], *self._place[:, None]])

    @property
    def unclamped(self) -> Hypothesis:
        return PayloadHypothesis(arm=self.arm, site=self.site, form=self.form, setting=self.setting)

    def parameters(self, theta: Array) -> dict[str, float]:
        return super().parameters(theta) | dict(self.setting)


@dataclass(frozen=True, eq=False, kw_only=True)
class PlacedPayloadHypothesis(FarPayloadHypothesis):
    """A link carries a point mass at a place that is known: its mass is the one parameter."""

    STATED = True

    refine_first = False

    @property
    def _largest_distance(self) -> float:
        """It is where it is stated to be."""
        return 2.0 * _REACH  # of each coordinate

    @property
    def unclamped(self) -> Hypothesis:
        return self

    def _claim(self, parameters: Mapping[str, Estimate], words: Words) -> str:
        place = ", ".join(f"{axis} {1e3 * self.setting[axis]:.4g}" for axis in AXES)
        return f"{super()._claim(parameters, words)}, at {place} mm in the link's frame as stated"


def place_of(arm: Arm, text: str) -> tuple[int, Array]:
    """Return the body and (3,) place, m, of ``LINK[:X,Y,Z]`` in that link's frame.

    ``LINK`` is a link's name or a joint's, for the link that it moves; a link's name goes first.
    A link on a fixed joint, or one that is held (``tool0``), is a place on the link that moves it.
    Without coordinates it is the link's end: where the next link is attached at zero, or the origin
    of its frame where none is.

    Raises:
        ConfigError: No link or joint of that name, or other than three finite numbers.
    """
    name, colon, rest = text.partition(":")
    joints = dict(zip(arm.joint_names, links_of_joints(arm), strict=True))
    named = name in arm.body_names or name in arm.merged or name not in joints
    link = name if named else arm.body_names[joints[name]]
    try:
        body, frame = arm.carrier(link)
    except ConfigError as error:
        known = ", ".join((*arm.body_names, *arm.joint_names))
        expected = f"LINK or LINK:X,Y,Z with a link or joint of {known}"
        raise ConfigError("--payload-at", text, expected) from error
    if not colon:
        end = np.zeros(3) if link in arm.merged else _attachment_point(arm, body)
        return body, np.asarray(frame.act(end))
    try:
        place = np.array([float(part) for part in rest.split(",")])
    except ValueError:
        place = np.zeros(0)
    if place.shape != (3,) or not (np.abs(place) <= _REACH).all():
        expected = f"{name}:X,Y,Z in m within {_REACH:g} m of the link's frame"
        raise ConfigError("--payload-at", text, expected)
    return body, np.asarray(frame.act(place))


def require_visible_load(motion: Motion, text: str) -> None:
    """Refuse a place at which a motion does not show a mass.

    Raises:
        ConfigError: Recordings of some joints, or a place at which a mass has no torque.
    """
    hypothesis = next(Payload.hypotheses(motion), None)
    if hypothesis is None:
        raise ConfigError("--payload-at", text, "none with recordings of some joints: record all")
    if np.abs(hypothesis.regressor(motion)).max() < _NO_TORQUE:
        raise ConfigError(
            "--payload-at", text,
            "LINK:X,Y,Z away from the axes: a mass there has no torque in this motion",
        )  # fmt: skip


def _attachment_point(arm: Arm, body: int) -> Array:
    """Return (3,) where the next link of the chain is attached, in a body's link frame, m."""
    # Links that joints move first; those that follow joints are attached somewhere, too.
    links = (*links_of_joints(arm), *range(len(arm.bodies)))
    following = [other for other in links if arm.bodies[other].parent == body]
    if not following:
        return np.zeros(3)
    frame = arm.bodies[body].frame
    return np.asarray(frame.actInv(arm.bodies[following[0]].placement.translation))


def _centre(parameters: Mapping[str, Estimate]) -> str:
    """Return where a load's centre of mass is, as far as that is known; ``""`` if nowhere."""
    known = [
        axis
        for axis in AXES
        if _UNSEEN
        < parameters[axis].high - parameters[axis].low
        < 2.0 * max(_PLACED, _PART_OF_WAY * abs(parameters[axis].value))
    ]
    if not known:
        return ""
    placed = ", ".join(f"{axis} {parameters[axis].shown}" for axis in known)
    rest = " and ".join(axis for axis in AXES if axis not in known)
    untold = f" ({rest} cannot be determined from this motion)" if rest else ""
    return f", its centre at {placed} in the link's frame{untold}"
