"""All friction that a model has is another one by a factor, at every joint: warmth, an idle month.

Joint by joint that takes as many causes as there are joints, and each alone explains less than one
wrong cause that all of them feel, a scale of all efforts, say.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.effects.base.effect import Hypothesis, Values, or_extended
from dvrk_gravity.effects.base.evidence import Motion
from dvrk_gravity.effects.base.meaning import Estimate
from dvrk_gravity.effects.base.site import THE_ARM
from dvrk_gravity.effects.base.state import State
from dvrk_gravity.effects.base.term import LinearTerm

FACTOR = "factor"
_NONE = -0.05  # of friction, by which an estimate of none may scatter. Chosen


@dataclass(frozen=True, eq=False, kw_only=True)
class AllFriction(Hypothesis):
    """Friction of a model times a factor; subclasses say whose effect it is.

    Attributes:
        divided: One factor for all (``""``), for each of its ``kinds``, or for each kind at each of
            the ``joints``: what it is only if these do not differ.
        kinds: Effects that are its friction, by name.
        titles: The same as a person writes them.
    """

    divided: Literal["", "kinds", "joints"] = ""
    kinds: tuple[str, ...] = ()
    titles: tuple[str, ...] = ()
    variable: str = "velocity"
    directed: bool = True
    common_cause: bool = True

    @classmethod
    def of(cls, motion: Motion) -> Iterator[AllFriction]:
        """Yield it of a model that rubs at several joints and was identified, with its kinds."""
        rubs = np.flatnonzero(motion.friction.any(axis=0)).tolist()
        if motion.static or motion.model.of_file or len(rubs) < 2:
            return
        terms = [term for term in motion.model.terms if term.FRICTION]
        whole = cls(
            arm=motion.arm, site=THE_ARM, joints=tuple(rubs), form="all",
            kinds=tuple(term.NAME for term in terms),
            titles=tuple(term.title() for term in terms),
        )  # fmt: skip
        yield whole
        if len(terms) > 1:
            yield replace(whole, divided="kinds", form="all, by kind")

    @property
    def unrestricted(self) -> AllFriction | None:
        """See :meth:`Hypothesis.unrestricted`: every kind at every joint."""
        return None if self.divided == "joints" else replace(self, divided="joints", form="each")

    def regressor(self, motion: Motion) -> Array:
        """See :meth:`Hypothesis.regressor`."""
        if not self.divided:
            return motion.friction[:, :, None]
        state = State(motion.true_q, motion.qd, motion.qdd)
        terms = {term.NAME: term for term in motion.model.terms}
        kinds = np.stack([terms[kind].torque(state) for kind in self.kinds], axis=2)
        if self.divided == "kinds":
            return kinds
        pieces = kinds[:, :, :, None] * np.eye(self.arm.n)[:, None, self.joints]
        return pieces.reshape(*kinds.shape[:2], -1)

    def parameters(self, theta: Array) -> dict[str, float]:
        """See :meth:`Hypothesis.parameters`."""
        factors = (1.0 + theta).tolist()
        if not self.divided:
            return {FACTOR: factors[0]}
        if self.divided == "kinds":
            named = zip(self.kinds, factors, strict=True)
            return {f"{kind}_{FACTOR}": factor for kind, factor in named}
        return {f"{FACTOR}_{index}": factor for index, factor in enumerate(factors)}

    def plausible(self, theta: Array) -> bool:
        """See :meth:`Hypothesis.plausible`: there may be none left, but none that drives."""
        return bool((1.0 + theta >= _NONE).all())

    def claim(self, parameters: Mapping[str, Estimate]) -> str:
        """See :meth:`Hypothesis.claim`."""
        told = self._in_words(parameters)
        if not self.divided:
            return f"there is {told[FACTOR]} friction than in {self.against}"
        named = [(f"{kind}_{FACTOR}", t) for kind, t in zip(self.kinds, self.titles, strict=True)]
        sure = [(name, title) for name, title in named if not parameters[name].doubtful(1.0)]
        kinds = " and ".join(f"{told[name]} {title}" for name, title in sure or named)
        return f"there is {kinds} than in {self.against}"

    def remedy(self, carried: bool) -> str:
        """See :meth:`Hypothesis.remedy`: no joint's own."""
        return or_extended(
            "if the arm is as warm as it was, look at what all joints share", carried
        )

    def merge(self, values: Values, theta: Array, motion: Motion) -> Values:
        """See :meth:`Hypothesis.merge`; of what is linear in its parameters, none below none."""
        changed = dict(values)
        by_kind = dict(zip(self.kinds, np.broadcast_to(theta, len(self.kinds)), strict=True))
        for term in motion.model.terms:
            if term.NAME not in by_kind or not isinstance(term, LinearTerm):
                continue
            had, factor = term.parameters(), max(1.0 + by_kind[term.NAME], 0.0)
            has = term.with_theta(factor * term.theta).parameters()
            for name, before in had.items():
                nothing = np.zeros(np.shape(before))  # what is nothing has no name in a file
                if has.get(name) != before:
                    more = np.asarray(has.get(name, nothing)) - np.asarray(before)
                    total = np.array(values.get(name, nothing), dtype=float)
                    # What was found beside it, an element of presliding say, comes after it.
                    total[: len(more)] += more
                    changed[name] = tuple(total.tolist())
        return changed
