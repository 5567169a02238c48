"""Torque or motion that leaks from one joint into another: a wrong transmission matrix."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects.base.arrays import as_value, joint_array
from dvrk_gravity.effects.base.effect import Hypothesis
from dvrk_gravity.effects.base.meaning import Estimate, Meaning, Words, meanings
from dvrk_gravity.effects.base.motion import Motion
from dvrk_gravity.effects.base.reading_errors import ReadingErrors
from dvrk_gravity.effects.base.sensor import SensorEffect, is_diagonal, require_factors
from dvrk_gravity.effects.base.site import Site
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.parameters import Parameter, Value

_WORST = 1e6  # condition number of a map; above, efforts or positions are not determined. Chosen
_SMALL = 1e-3  # below: a slope serves in place of a secant


class JointCoupling(SensorEffect):
    """The reading of one joint contains a fraction of another's."""

    NAME = "joint_coupling"
    FROM = ("effort", "position")
    REMEDY = "check the transmission matrix (actuator to joint) at {joint}"
    MEANINGS = meanings(
        factor=Meaning("", 0.0, ("", "with the opposite sign"), "leaks", percent=True)
    )

    @classmethod
    def schema(cls, arm: Arm) -> tuple[Parameter, ...]:
        meaning = "what this joint's reading has of each joint's {}"
        return tuple(
            replace(joint_array(arm, _row(what, joint), "1", meaning.format(what)), units=())
            for what in cls.FROM
            for joint in arm.joint_names
        )

    @classmethod
    def read(cls, arm: Arm, values: Mapping[str, Value], errors: ReadingErrors) -> ReadingErrors:
        effort, position = (_map(arm, values, what) for what in cls.FROM)
        return replace(errors, effort=errors.effort @ effort, position=errors.position @ position)

    @classmethod
    def written(cls, arm: Arm, errors: ReadingErrors) -> dict[str, Value]:
        return {
            _row(what, joint): as_value(row)
            for what, rows in (("effort", errors.effort), ("position", errors.position))
            if not is_diagonal(rows)
            for joint, row, unit in zip(arm.joint_names, rows, np.eye(arm.n), strict=True)
            if not np.array_equal(row, unit)
        }

    @classmethod
    def hypotheses(cls, motion: Motion) -> Iterator[Hypothesis]:
        present = np.flatnonzero(motion.present).tolist()
        for target in present:
            for source in present:
                if source == target:
                    continue
                name = motion.arm.joint_names[source]
                yield TorqueLeak(
                    arm=motion.arm, site=Site.joint(target), joints=(target, source),
                    form=f"torque of {name} leaks",
                )  # fmt: skip
                yield MotionLeak(
                    arm=motion.arm, site=Site.joint(target), joints=(target, source),
                    form=f"motion of {name} leaks", setting={"factor": 0.0},
                )  # fmt: skip


def _map(arm: Arm, values: Mapping[str, Value], what: str) -> Array:
    """Return the (n, n) map from the joints' efforts or positions to the read ones."""
    given = [values.get(_row(what, joint)) for joint in arm.joint_names]
    rows = np.array([row or unit for row, unit in zip(given, np.eye(arm.n).tolist(), strict=True)])
    if not np.linalg.cond(rows) < _WORST:
        raise ConfigError(f"reading.{what}_from", rows.tolist(), "rows that can be solved")
    require_factors(arm, np.diag(rows), f"reading.{what}_from")
    return rows.astype(float)


def _row(what: str, joint: str) -> str:
    return f"reading.{what}_from.{joint}"


@dataclass(frozen=True, eq=False, kw_only=True)
class LeakHypothesis(Hypothesis):
    """A fraction of the second joint's torque or motion appears in the first joint's reading."""

    EFFECT = JointCoupling
    CLAIM = "{part} of {other}'s {what} leaks{turned} into the {read} read at {joint}"

    what: str
    read: str

    def parameters(self, theta: Array) -> dict[str, float]:
        return {"factor": float(theta[0])}

    def plausible(self, theta: Array) -> bool:
        """No more than the whole of the other's: beyond, the fit describes some other cause."""
        target, source = self.arm.scale[list(self.joints)]
        # Of a position in m, or an effort in N, a whole is that of a joint that turns by 1 rad.
        whole = source / target if self.EFFORT_READING else target / source
        return bool(abs(theta[0]) <= whole) and super().plausible(theta)

    def _map(self, theta: Array) -> Array:
        """Return the (n, n) map from what the joints do to what is read."""
        unit = np.eye(self.arm.n)
        target, source = self.joints
        return unit + float(theta[0]) * np.outer(unit[target], unit[source])

    @property
    def judged_at(self) -> tuple[int, ...]:
        return self.joints[:1]

    def _claim(self, parameters: Mapping[str, Estimate], words: Words) -> str:
        joint, other = self.names
        factor = parameters["factor"]
        turned = ", with the opposite sign," if factor.value < 0.0 else ""
        return self.CLAIM.format(
            part=factor.magnitude.percent().shown, other=other, what=self.what, turned=turned,
            read=self.read, joint=joint,
        )  # fmt: skip


@dataclass(frozen=True, eq=False, kw_only=True)
class TorqueLeak(LeakHypothesis):
    """effort = torque + factor x the other joint's torque."""

    EFFORT_READING = True
    what: str = "torque"
    read: str = "effort"

    def reading_errors(self, theta: Array) -> ReadingErrors:
        return replace(ReadingErrors.none(self.arm.n), effort=self._map(theta))

    def regressor(self, motion: Motion) -> Array:
        target, source = self.joints
        torque = np.zeros((*motion.q.shape, 1))
        torque[:, target, 0] = motion.applied_torque[:, source]
        return torque


@dataclass(frozen=True, eq=False, kw_only=True)
class MotionLeak(LeakHypothesis):
    """position = true position + factor x the other joint's position."""

    shifts_positions = True

    what: str = "motion"
    read: str = "position"
    fixed_point = ("factor",)

    def reading_errors(self, theta: Array) -> ReadingErrors:
        return replace(ReadingErrors.none(self.arm.n), position=self._map(theta))

    def regressor(self, motion: Motion) -> Array:
        target, source = self.joints
        step = self.setting["factor"]
        if abs(step) < _SMALL:
            return -(motion.slope[:, :, target] * motion.q[:, [source]])[:, :, None]
        there = motion.q.copy()
        there[:, target] -= step * motion.q[:, source]
        return ((motion.torque_at(there) - motion.modelled) / step)[:, :, None]
