"""Links whose centre of mass is not where the model has it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from dvrk_gravity import gravity
from dvrk_gravity.arms import GRAVITY, PER_LINK, Arm, is_mtm, weight_regressor
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects.base.arrays import Values
from dvrk_gravity.effects.base.effect import Effect, Hypothesis
from dvrk_gravity.effects.base.links import (
    AXES,
    beta_map,
    prior_scale,
    weight_directions,
)
from dvrk_gravity.effects.base.meaning import Estimate, Meaning, Words, size
from dvrk_gravity.effects.base.motion import Motion
from dvrk_gravity.effects.base.site import THE_ARM, Site, joints_with_weight, links_of_joints
from dvrk_gravity.effects.gravity import link_beta, with_beta
from dvrk_gravity.effects.link_inertia import with_inertia
from dvrk_gravity.effects.link_weight import with_weight

_ENTRY = ("too small", "too great")
# The joint whose link carries each entry of beta.
_BETA_JOINTS = (1, 1, 2, 2, 3, 4, 4, 4, 5, 5, 6, 6)
_WHOLE = len(gravity.BETA_NAMES)
_ALL = "weight of all links"


class LinkCom(Effect):
    """A link's first moment differs from the model's."""

    NAME = "link_com"
    REMEDY = "see whether something was fastened to the link or taken off it"
    TITLE = "centre of mass"

    @classmethod
    def meaning(cls, name: str) -> Meaning:
        if name == "delta_beta":
            return size("N·m", _ENTRY, "the model's weight moment is")
        which = name.removeprefix("delta_beta_")
        along = (f"along +{which}", f"along -{which}") if which in AXES else _ENTRY
        return size("N·m", along, f"weight moment {which}")

    @classmethod
    def hypotheses(cls, motion: Motion) -> Iterator[Hypothesis]:
        """For each link along each axis and all; entries of beta; all weights."""
        if not motion.present.all() or motion.payload_at is not None:
            return
        arm = motion.arm
        for joint in joints_with_weight(arm):
            link = links_of_joints(arm)[joint]
            for axes in ((0,), (1,), (2,), (0, 1, 2)):
                letters = "".join(AXES[axis] for axis in axes)
                yield MomentHypothesis(
                    arm=arm, site=Site.link(link), joints=(joint,),
                    form=f"{arm.body_names[link]} {letters}", axes=axes,
                )  # fmt: skip
        if not is_mtm(arm):
            yield LinkWeightsHypothesis(
                arm=arm,
                site=THE_ARM,
                form=_ALL,
                directions=weight_directions(arm),
                prior_std=(1.0,) * weight_directions(arm).shape[1],
            )
            return
        for entry, joint in enumerate(_BETA_JOINTS):
            yield BetaHypothesis(
                arm=arm, site=Site.link(links_of_joints(arm)[joint]), joints=(joint,),
                form=f"weight only, {gravity.BETA_NAMES[entry]}", entry=entry,
            )  # fmt: skip
        yield AllWeightsHypothesis(arm=arm, site=THE_ARM, form=_ALL, prior_std=_plausible(arm))


@dataclass(frozen=True, eq=False, kw_only=True)
class MomentHypothesis(Hypothesis):
    """A link's centre of mass is displaced along some axes of its frame.

    Attributes:
        axes: Indices of the axes.
    """

    EFFECT = LinkCom
    EXPLAINED_BY = "payload"

    axes: tuple[int, ...]

    def meaning(self, name: str) -> Meaning:
        """Of a change along one axis that is named, too."""
        along = f"delta_beta_{AXES[self.axes[0]]}"
        return super().meaning(along if len(self.axes) == 1 else name)

    @property
    def _directions(self) -> Array:
        """(10, k) inertial parameters per N·m of weight moment along the axes."""
        directions = np.zeros((PER_LINK, len(self.axes)))
        frame = self.arm.bodies[self.site.index].frame
        directions[1:4] = frame.rotation[:, list(self.axes)]
        return directions / GRAVITY

    def regressor(self, motion: Motion) -> Array:
        return motion.link_torque(self.site.index, self._directions)

    def parameters(self, theta: Array) -> dict[str, float]:
        if len(self.axes) == 1:
            return {"delta_beta": float(theta[0])}
        return {f"delta_beta_{AXES[a]}": float(t) for a, t in zip(self.axes, theta, strict=True)}

    def merge(self, values: Values, theta: Array, motion: Motion) -> Values | None:
        return with_link(self.arm, values, self.site.index, self._directions @ theta)

    def _claim(self, parameters: Mapping[str, Estimate], words: Words) -> str:
        along = ", ".join(words[name] for name in parameters)
        link = self.site.words(self.arm)
        return (
            f"the centre of mass of {link} is not where {self.against} has it: "
            f"its weight moment is off by {along}"
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class BetaHypothesis(Hypothesis):
    """One entry of beta is wrong: a spring or a counterweight, weight without inertia.

    Attributes:
        entry: Its index.
    """

    EFFECT = LinkCom

    entry: int

    def regressor(self, motion: Motion) -> Array:
        regressor = gravity.regressor(motion.true_q, motion.gravity, len(_BETA_JOINTS))
        return regressor[:, :, [self.entry]]

    def parameters(self, theta: Array) -> dict[str, float]:
        return {"delta_beta": float(theta[0])}

    def merge(self, values: Values, theta: Array, motion: Motion) -> Values | None:
        return with_beta(values, float(theta[0]) * np.eye(_WHOLE)[self.entry])

    def _claim(self, parameters: Mapping[str, Estimate], words: Words) -> str:
        name, change = gravity.BETA_NAMES[self.entry], words["delta_beta"]
        return f"{self.against}'s weight moment {name} of {self.site.words(self.arm)} is {change}"


@dataclass(frozen=True, eq=False, kw_only=True)
class AllWeightsHypothesis(Hypothesis):
    """All of beta is fitted again."""

    EFFECT = LinkCom
    CLAIM = "the links' weights as a whole differ from {model}'s"

    refits_model = True

    def regressor(self, motion: Motion) -> Array:
        return gravity.regressor(motion.true_q, motion.gravity, len(_BETA_JOINTS))

    def parameters(self, theta: Array) -> dict[str, float]:
        names = gravity.BETA_NAMES
        return {f"delta_beta_{n}": float(v) for n, v in zip(names, theta, strict=False)}

    def merge(self, values: Values, theta: Array, motion: Motion) -> Values | None:
        return with_beta(values, np.pad(theta, (0, _WHOLE - len(theta))))


@dataclass(frozen=True, eq=False, kw_only=True)
class LinkWeightsHypothesis(Hypothesis):
    """All links' weights are fitted again, of an arm that has no beta.

    Attributes:
        directions: (4 bodies, k) combinations of masses and first moments that show, each of its
            plausible size.
    """

    EFFECT = LinkCom
    CLAIM = "the links' weights as a whole differ from {model}'s"

    directions: Array
    refits_model = True

    def regressor(self, motion: Motion) -> Array:
        return weight_regressor(self.arm, motion.true_q, motion.gravity) @ self.directions

    def parameters(self, theta: Array) -> dict[str, float]:
        return {}

    def merge(self, values: Values, theta: Array, motion: Motion) -> Values | None:
        change = (self.directions @ theta).reshape(len(self.arm.bodies), -1)
        return with_weight(self.arm, values, change)


def with_link(arm: Arm, values: Values, index: int, change: Array) -> Values | None:
    """Return a model's parameters with (10,) more of a body, in its joint's frame.

    ``None`` if the model has no weights that could be others.
    """
    body = arm.bodies[index]
    if is_mtm(arm):
        # beta is made of first moments in the link's own frame.
        moment = change[1:4] - change[0] * body.frame.translation
        beta = link_beta(body.name, float(change[0]), body.frame.rotation.T @ moment)
        result = with_beta(values, beta)
    else:
        weights = np.zeros((len(arm.bodies), 4))
        weights[index] = change[:4]
        result = with_weight(arm, values, weights)
    return None if result is None else with_inertia(values=result, body=body.name, change=change)


def _plausible(arm: Arm) -> tuple[float, ...]:
    """Return plausible sizes of beta's entries."""
    rows = beta_map(arm)[: len(_BETA_JOINTS)] * prior_scale(arm)
    return tuple(np.linalg.norm(rows, axis=1).tolist())
