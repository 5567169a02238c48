"""A base that is not mounted as assumed."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pinocchio as pin

from dvrk_gravity import gravity
from dvrk_gravity.arms import Arm, rigid_body
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects.base.arrays import Values, as_value
from dvrk_gravity.effects.base.column import MISPLACED, Column
from dvrk_gravity.effects.base.effect import Effect, Hypothesis, remedy_text
from dvrk_gravity.effects.base.links import prior_scale
from dvrk_gravity.effects.base.meaning import Meaning, meanings
from dvrk_gravity.effects.base.motion import Motion
from dvrk_gravity.effects.base.site import THE_BASE
from dvrk_gravity.effects.gravity import Gravity, with_beta
from dvrk_gravity.effects.link_weight import with_weight

MAX_TILT = 0.6
"""rad: a base that leans further was mounted so. Chosen."""

_SHAFT = 0.03  # N·m that link 1 may plausibly weigh on its joint in a base that is tilted
_LEANING = 0.1  # rad: a tilt of which all arms are asked what link 1 plausibly weighs
_STEP = 1e-4  # rad, for a difference quotient
_SIZE = 0.1  # of gravity's size, by which that of a base mounted otherwise may seem off. Chosen
_LEVEL = 12  # entries of beta that an upright base shows


class BaseTilt(Effect):
    """Gravity has another direction in the base frame than the model assumes."""

    NAME = "base_tilt"
    IN_FILES = ("urdf", "mjcf")
    REMEDY = "level the base"
    MEANINGS = meanings(
        roll=Meaning("rad", 0.0, least=-np.pi, greatest=np.pi),
        pitch=Meaning("rad", 0.0, least=-0.5 * np.pi, greatest=0.5 * np.pi),
    )

    @classmethod
    def kinematic_columns(cls, arm: Arm) -> tuple[Column, ...]:
        """Return the columns of the base's roll and pitch, per rad."""
        return tuple(Column(cls.NAME, THE_BASE, axis, MISPLACED) for axis in range(2))

    @classmethod
    def hypotheses(cls, motion: Motion) -> Iterator[Hypothesis]:
        if not motion.present.all() or not any(term.carries_arm for term in motion.model.terms):
            return
        shaft = _unknown_shaft_weight(motion)
        of_shaft = (shaft, shaft) if shaft else ()
        yield TiltHypothesis(
            arm=motion.arm, site=THE_BASE, setting={"roll": 0.0, "pitch": 0.0},
            knows_shaft=not shaft, prior_std=(np.inf, np.inf, *of_shaft) if shaft else (),
        )  # fmt: skip
        yield MountingHypothesis(
            arm=motion.arm, site=THE_BASE, form="mounting",
            gravity=tuple(motion.gravity.tolist()),
            knows_shaft=not shaft, prior_std=(*3 * (np.inf,), *of_shaft) if shaft else (),
        )  # fmt: skip

    @classmethod
    def unit_changes(cls, motion: Motion) -> Iterator[tuple[Hypothesis, Array]]:
        """About horizontal axes that are 45 degrees apart."""
        for each in cls.hypotheses(motion):
            if isinstance(each, TiltHypothesis):
                for angle in 0.25 * np.pi * np.arange(4):
                    theta = np.zeros(2 if each.knows_shaft else 4)
                    theta[:2] = np.cos(angle), np.sin(angle)
                    yield each, theta


class ChangesModelTorque(ABC):
    """A hypothesis beside which the model's own parameters produce other torques."""

    @abstractmethod
    def applied_to(self, model: Any, theta: Array) -> Any:
        """Return a :class:`~dvrk_gravity.model.TorqueModel` as it is with (k,) theta present."""


@dataclass(frozen=True, eq=False, kw_only=True)
class _BaseHypothesis(ChangesModelTorque, Hypothesis):
    """The base is tilted.

    Attributes:
        knows_shaft: Whether the model knows what link 1 weighs, which a level base never shows: it
            turns about the vertical. If not, that comes with the tilt.
    """

    EFFECT = BaseTilt
    CLAIM = "the base is tilted relative to {model}'s, by {roll} of roll and {pitch} of pitch"

    knows_shaft: bool

    def _with_shaft(self, motion: Motion, columns: Sequence[Array]) -> Array:
        shaft = np.zeros((0 if self.knows_shaft else 2, *columns[0].shape))
        if len(shaft):
            shaft[:, :, 0] = _shaft_torque(motion.true_q)
        return np.stack([*columns, *shaft], axis=2)

    def applied_to(self, model: Any, theta: Array) -> Any:
        vector = _rotate(model.gravity, **self.parameters(theta))
        weighing = (
            term if term.gravity_vector is None else term.with_gravity(vector)
            for term in model.terms
        )
        return replace(model, terms=tuple(weighing))

    def merge(self, values: Values, theta: Array, motion: Motion) -> Values | None:
        vector = _rotate(motion.gravity, **self.parameters(theta))
        values = {**values, "gravity_vector": as_value(vector)}
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
        moments = np.linalg.lstsq(per_moment, theta[-2:] @ _shaft_torque(q), rcond=None)[0]
        if of_beta:
            return with_beta(values, np.pad(moments, (_LEVEL, 0)))
        change = np.zeros((len(self.arm.bodies), rigid_body.OF_WEIGHT))
        change[0, 1:3] = moments
        return with_weight(self.arm, values, change)

    @property
    def subject(self) -> str:
        return "a tilt of the base"


@dataclass(frozen=True, eq=False, kw_only=True)
class TiltHypothesis(_BaseHypothesis):
    """The base is tilted by a small angle, at most :data:`MAX_TILT`."""

    fixed_point = ("roll", "pitch")
    alignment = True

    def regressor(self, motion: Motion) -> Array:
        """Return the mean torque of each turn before and after the other (Shapley's value).

        Both together are then the torque of the tilt, however large it is.
        """
        roll, pitch = (
            angle if abs(angle) > _STEP else _STEP
            for angle in (self.setting["roll"], self.setting["pitch"])
        )
        level, rolled, pitched, both = (
            _weight_torque(motion, _rotate(motion.gravity, *angles))
            for angles in ((0.0, 0.0), (roll, 0.0), (0.0, pitch), (roll, pitch))
        )
        columns = [
            (rolled - level + both - pitched) / (2.0 * roll),
            (pitched - level + both - rolled) / (2.0 * pitch),
        ]
        return self._with_shaft(motion, columns)

    def parameters(self, theta: Array) -> dict[str, float]:
        return {"roll": float(theta[0]), "pitch": float(theta[1])}

    def plausible(self, theta: Array) -> bool:
        return bool(np.abs(theta[:2]).max() <= MAX_TILT) and super().plausible(theta)


@dataclass(frozen=True, eq=False, kw_only=True)
class MountingHypothesis(_BaseHypothesis):
    """The base hangs, from a wall or a ceiling, say: the torque is linear in gravity's vector.

    Attributes:
        gravity: (3,) the model's, in the base's frame, m/s^2.
    """

    gravity: tuple[float, ...]

    def regressor(self, motion: Motion) -> Array:
        """Return torques per m/s^2 of gravity along each axis of the base."""
        level = _weight_torque(motion, motion.gravity)
        along = [_weight_torque(motion, motion.gravity + axis) - level for axis in np.eye(3)]
        return self._with_shaft(motion, along)

    def parameters(self, theta: Array) -> dict[str, float]:
        roll, pitch = _angles(np.array(self.gravity), np.array(self.gravity) + theta[:3])
        # Walls and ceilings are away from where the angle jumps by a turn.
        jumps = -0.75 * np.pi
        return {"roll": (roll - jumps) % (2.0 * np.pi) + jumps, "pitch": pitch}

    def plausible(self, theta: Array) -> bool:
        """Gravity's magnitude must be right, and the angle beyond :data:`MAX_TILT`."""
        had = np.array(self.gravity)
        size = float(np.linalg.norm(had + theta[:3]) / np.linalg.norm(had))
        angles = self.parameters(theta).values()
        return abs(size - 1.0) <= _SIZE and max(map(abs, angles)) > MAX_TILT

    def remedy(self, carried: bool) -> str:
        return remedy_text("mount the base as the model has it", carried)


def _unknown_shaft_weight(motion: Motion) -> float:
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


def _rotate(vector: Array, roll: float, pitch: float) -> Array:
    """Return (3,) a vector as a base has it that is turned further by roll and pitch, rad."""
    return np.asarray(pin.rpy.rpyToMatrix(roll, pitch, 0.0).T @ vector)


def _angles(before: Array, after: Array) -> tuple[float, float]:
    """Return roll and the smaller pitch, rad, by which :func:`_rotate` goes from one to another.

    Pitch alone sets the x component, roll then the others. Of a turn about the vertical, which
    gravity does not show, there is none.
    """
    x, y, z = before / np.linalg.norm(before)
    to_x, to_y, to_z = after / np.linalg.norm(after)
    in_plane = float(np.hypot(x, z))
    turn = float(np.arccos(np.clip(to_x / max(in_plane, _STEP), -1.0, 1.0)))
    either = np.array([turn, -turn]) - np.arctan2(z, x)
    pitch = min(np.angle(np.exp(1j * either)).tolist(), key=abs)
    below = x * np.sin(pitch) + z * np.cos(pitch)
    return float(np.arctan2(to_y * below - to_z * y, to_y * y + to_z * below)), pitch


def _weight_torque(motion: Motion, vector: Array) -> Array:
    """Return (N, n) torque of the model in a base in which gravity is another one, m/s^2."""
    terms = tuple(
        term.with_gravity(vector) for term in motion.model.terms if term.gravity_vector is not None
    )
    return motion.torque_at(motion.q, replace(motion.model, terms=terms))
