"""A base that is not mounted as assumed."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from dvrk_gravity import gravity
from dvrk_gravity.effects.base import rigid_body, site
from dvrk_gravity.effects.base.effect import Effect, Hypothesis, Setting
from dvrk_gravity.effects.base.evidence import Motion
from dvrk_gravity.effects.base.link_prior import prior_scale
from dvrk_gravity.effects.base.meaning import Meaning, meanings
from dvrk_gravity.effects.base.merging import Values
from dvrk_gravity.effects.gravity import Gravity, with_beta
from dvrk_gravity.effects.link_weight import with_weight

Array = NDArray[np.float64]

_SHAFT = 0.03  # N·m that link 1 may plausibly weigh on its joint in a base that is tilted
_LEANING = 0.1  # rad: a tilt of which all arms are asked what link 1 plausibly weighs
_STEP = 1e-4  # rad, for a difference quotient
_LEVEL = 12  # entries of beta that an upright base shows


class BaseTilt(Effect):
    """Gravity comes from another direction than the model takes it to."""

    NAME = "base_tilt"
    REMEDY = "level the base"
    MEANINGS = meanings(
        roll=Meaning("rad", 0.0, least=-0.6, greatest=0.6),
        pitch=Meaning("rad", 0.0, least=-0.6, greatest=0.6),
    )

    @classmethod
    def hypotheses(cls, motion: Motion) -> Iterator[Hypothesis]:
        """See :meth:`Effect.hypotheses`."""
        if not motion.present.all() or not any(term.carries_arm for term in motion.model.terms):
            return
        shaft = _unknown_of_shaft(motion)
        yield TiltHypothesis(
            arm=motion.arm, site=site.THE_BASE, setting={"roll": 0.0, "pitch": 0.0},
            knows_shaft=not shaft, plausible_size=(np.inf, np.inf, shaft, shaft) if shaft else (),
        )  # fmt: skip


@dataclass(frozen=True, eq=False, kw_only=True)
class TiltHypothesis(Hypothesis):
    """The base is tilted.

    Attributes:
        knows_shaft: Whether the model knows what link 1 weighs, which a level base never shows: it
            turns about the vertical. If not, that comes with the tilt.
    """

    EFFECT = BaseTilt
    CLAIM = "the base is tilted against {model}'s, by {roll} of roll and {pitch} of pitch"

    knows_shaft: bool
    fixed_point: tuple[str, ...] = ("roll", "pitch")
    alignment: bool = True

    def build(self, motion: Motion, setting: Setting) -> Array:
        """See :meth:`Hypothesis.build`.

        What a turn adds before and after the other one, on average (Shapley's value): so both
        together are the torque of the tilt, however large it is.
        """
        roll, pitch = (
            angle if abs(angle) > _STEP else _STEP for angle in (setting["roll"], setting["pitch"])
        )
        level, rolled, pitched, both = (
            _tilted_torque(motion, *angles)
            for angles in ((0.0, 0.0), (roll, 0.0), (0.0, pitch), (roll, pitch))
        )
        columns = [
            (rolled - level + both - pitched) / (2.0 * roll),
            (pitched - level + both - rolled) / (2.0 * pitch),
        ]
        if not self.knows_shaft:
            shaft = np.zeros((2, *level.shape))
            shaft[:, :, 0] = _shaft_torque(motion.true_q)
            columns += [*shaft]
        return np.stack(columns, axis=2)

    def describe(self, theta: Array, setting: Setting) -> dict[str, float]:
        """See :meth:`Hypothesis.describe`."""
        del setting
        return {"roll": float(theta[0]), "pitch": float(theta[1])}

    def merge(self, values: Values, theta: Array, motion: Motion) -> Values | None:
        """See :meth:`Hypothesis.merge`."""
        turn = pin.rpy.rpyToMatrix(float(theta[0]), float(theta[1]), 0.0).T
        vector = turn @ motion.gravity
        values = {**values, "gravity_vector": tuple(vector.tolist())}
        if self.knows_shaft:
            return values
        # What weighs on a shaft that leans, as the first moments of link 1.
        q = np.zeros((4, len(self.arm.joints)))
        q[:, 0] = np.linspace(-1.0, 1.0, len(q))
        of_beta = isinstance(motion.model.term(Gravity.NAME), Gravity)
        per_moment = (
            gravity.regressor(q, vector, len(gravity.BETA_NAMES))[:, 0, _LEVEL:]
            if of_beta
            else rigid_body.weight_regressor(self.arm, q, vector)[:, 0, 1:3]
        )
        moments = np.linalg.lstsq(per_moment, theta[2:] @ _shaft_torque(q), rcond=None)[0]
        if of_beta:
            return with_beta(values, np.pad(moments, (_LEVEL, 0)))
        change = np.zeros((len(self.arm.bodies), rigid_body.OF_WEIGHT))
        change[0, 1:3] = moments
        return with_weight(self.arm, values, change)

    @property
    def subject(self) -> str:
        """See :meth:`Hypothesis.subject`."""
        return "a tilt of the base"


def _unknown_of_shaft(motion: Motion) -> float:
    """Return what link 1 may weigh on its joint once that leans, N·m; 0 where the model knows.

    About a vertical axis nothing weighs, so no upright motion has shown it.
    """
    weight, arm = motion.model.term(Gravity.NAME), motion.arm
    if isinstance(weight, Gravity):
        return _SHAFT if len(weight.beta) <= _LEVEL else 0.0
    if motion.model.uncertainty is None or motion.model.of_file:
        return 0.0
    first = arm.bodies[0]
    turns = first.kind == "revolute" and np.array_equal(first.row, np.eye(arm.n)[0])
    upright = np.cross(first.placement.rotation[:, 2], motion.gravity)
    if not turns or np.linalg.norm(upright) > _STEP * np.linalg.norm(motion.gravity):
        return 0.0
    moments = prior_scale(arm).reshape(len(arm.bodies), -1)[:, 1]
    return float(_LEANING * np.linalg.norm(motion.gravity) * np.linalg.norm(moments))


def _shaft_torque(q: Array) -> Array:
    """Return (2, N) torques of a weight on link 1 at (N, n) positions, in a base that is tilted."""
    return np.stack([np.cos(q[:, 0]), np.sin(q[:, 0])])


def _tilted_torque(motion: Motion, roll: float, pitch: float) -> Array:
    """Return (N, n) torque of what has weight, its base turned further by roll and pitch, rad."""
    turn = pin.rpy.rpyToMatrix(roll, pitch, 0.0).T
    terms = tuple(
        term.with_gravity(turn @ term.gravity_vector)
        for term in motion.model.terms
        if term.gravity_vector is not None
    )
    return motion.torque_at(motion.q, replace(motion.model, terms=terms))
