"""What positions are that are no angles in rad: degrees, ticks, parts of a range, motor angles.

Each is an angle times a factor, from another zero. The arm's limits, recorded velocities, and the
weight of the masses in the arm's file, which the efforts show, decide between them.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from dvrk_gravity.arms import rigid_body
from dvrk_gravity.arrays import Array, Mask
from dvrk_gravity.recording.samples import Samples, not_recorded

DEGREE = np.pi / 180.0
_TURN = 2.0 * np.pi
# Steps a turn of servos and encoders in use: Dynamixel AX, older encoders, Dynamixel X and Feetech
# STS, and encoders of 14, 16, 17 and 19 bits.
_TICKS = (1024, 2048, 4096, 16384, 65536, 131072, 524288)
ENDLESS = 4.0 * _TURN  # rad, that a joint without limits turns by. Chosen: cables wind up
_PAST = 0.35  # rad past a limit, which the error of a zero explains. Chosen as for ``arm_limits``
_SAMPLES = 300  # on which weight is compared: a bound on time
_MOMENT = 0.05  # s, over which velocities are compared with ways. Chosen
_SAME_SPEED = 0.2  # relative difference of two factors of velocity that are one. Chosen
_CLEAR = 0.9  # correlation from which on such a factor is one. Chosen as for ``velocity``
# Part of the squared efforts that the right unit leaves beside weight and friction. Seen of
# simulated arms: .005 to .015, with a load or rough masses up to .1. Multiple of it that another
# one leaves. Chosen.
_LEFT, _WORSE = 0.15, 2.0
# Positions within the arm's reach are believed unless they leave more than this part, and another
# unit less than a quarter of what they leave. Chosen as for another mounting
# (``observation.nominal``); where the other unit's factor is fitted, a tenth.
_BELIEVED, _DISPROVED, _FITTED = 0.02, 0.25, 0.1
# Gear ratios tried, in the least that keeps joints within their limits. Chosen: a motion uses more
# than an eighth of the ranges, and 3 % of a quarter of a turn is 3 deg.
_GEARS = np.exp(np.arange(0.0, np.log(8.0), 0.03))
_SAME = 0.05  # in the logarithm, of two factors that are one. Chosen beside the steps of these
_MOTORS = "motor angles", "divide them by the ratios of the arm's gears"


@dataclass(frozen=True, eq=False)
class PositionUnit:
    """What positions may be in.

    Attributes:
        words: Its name.
        remedy: How it is stated, or converted.
        factor: (n,) rad or m of one of it.
        zero: (n,) what is read at the joints' zeros.
        anywhere: Whether zeros are not known.
        fitted: Whether its factor is what weight shows best.
        misfit: Part of the efforts' variance that weight and friction leave; NaN: not known.
    """

    words: str
    remedy: str
    factor: Array
    zero: Array
    anywhere: bool = False
    fitted: bool = False
    misfit: float = np.nan

    def joint(self, read: Array) -> Array:
        """Return (N, n) joint positions, rad or m, of those that are read."""
        return self.factor * (read - self.zero)


def declaring(joint: str, quantity: str, unit: str) -> str:
    """Return how a user declares the unit of a joint's column; a bag's fields have no units."""
    return (
        f"declare it for each such column, --columns NAME={joint}.{quantity}[{unit}] (a bag: "
        "`convert` it to CSV first)"
    )


def other_units(recording: Samples, beyond: Mask) -> str:
    """Return what positions of some (n,) joints beyond an arm's reach should be, and may be."""
    positions = _Positions(recording, recording.position)
    found = positions.fitting([*positions.units(beyond), *positions.geared()])
    unit = "rad" if positions.turns[beyond].any() else "m"
    if not found or found[0].misfit > _LEFT:
        found.append(positions.unit(*_MOTORS, 1.0))
    if len(found) == 1:
        return f"{unit}, not {found[0].words}; {found[0].remedy}"
    some = ", or ".join(f"{each.words} ({each.remedy})" for each in found)
    return f"{unit}; they may be {some}"


def disproved(recording: Samples) -> str:
    """Return why positions within an arm's reach are not what they were read as; ``""``: they may.

    They were read as rad, or converted from degrees.
    """
    positions = _Positions(recording, recording.position)
    if positions.follow_velocities:  # what weighs otherwise is a tilt, or other masses
        return ""
    given = positions.judged(positions.unit("as they are read", "", 1.0))
    if not given.misfit > _BELIEVED:
        return ""
    none = np.zeros(len(positions.turns), dtype=bool)
    found = [*positions.units(none), *positions.geared()]
    degrees = _Positions(recording, recording.position / DEGREE)
    found = [*positions.fitting(found), *degrees.fitting(degrees.units(none))]
    best = min(found, key=lambda each: each.misfit, default=given)
    part = _FITTED if best.fitted else _DISPROVED
    if best.misfit > min(_LEFT, part * given.misfit):
        return ""
    return (
        f"positions are {best.words}, according to the masses in the arm's file: expected rad; "
        f"{best.remedy}; --effort-unit N·m if the masses are wrong"
    )


def without_friction(torque: Array, speed: Array, *more: Array) -> Array:
    """Return (N, k) torques of a joint without what friction at its (N,) speed can explain.

    Nor what ``more`` (N,) signals can, such as the acceleration of a rotor, which no file states.
    """
    friction = np.stack([np.sign(speed), speed, *more], axis=1)
    return np.asarray(torque - friction @ np.linalg.lstsq(friction, torque, rcond=None)[0])


class _Positions:
    """Positions of an arm's joints as they were read, and what shows their unit."""

    def __init__(self, recording: Samples, read: Array) -> None:
        assert recording.arm is not None
        self._recording, self._read, self._arm = recording, read, recording.arm
        joints = [self._arm.joints[self._arm.joint_names.index(n)] for n in recording.joints]
        self._names = recording.joints
        free = not self._arm.direct_drive  # the limits of motors that share joints are others
        self._lower = np.array([-np.inf if free else joint.lower for joint in joints])
        self._upper = np.array([np.inf if free else joint.upper for joint in joints])
        self.turns = np.array([joint.kind == "revolute" for joint in joints])
        self._low, self._high = read.min(axis=0), read.max(axis=0)

    def unit(
        self, words: str, remedy: str, factor: Array | float, zero: Array | float = 0.0,
        anywhere: bool = False,
    ) -> PositionUnit:  # fmt: skip
        """Return a unit of all joints."""
        every = np.ones(len(self._names))
        return PositionUnit(words, remedy, factor * every, zero * every, anywhere)

    def units(self, beyond: Mask) -> Iterator[PositionUnit]:
        """Yield known units; ``beyond``: (n,) joints that are known to be in another one."""
        turns, name = self.turns, self._names[int(np.argmax(beyond))]
        sliding = np.where(beyond, 1e-3, 1.0)
        if beyond.any():
            unit, words = ("deg", "degrees") if turns[beyond].any() else ("mm", "mm")
            remedy = declaring(name, "position", unit)
            yield self.unit(words, remedy, np.where(turns, DEGREE, sliding))
            if not beyond.all():
                some = ", ".join(np.array(self._names)[beyond])
                factor = np.where(beyond, np.where(turns, DEGREE, 1e-3), 1.0)
                yield self.unit(f"{words} at {some}", remedy, factor)
        yield self.unit("turns", "one is 2π rad", np.where(turns, _TURN, 1.0))
        if (self._read[:, turns] == np.round(self._read[:, turns])).all():
            for ticks in _TICKS:
                remedy = f"an angle is (ticks - those at its zero) · 2π/{ticks}"
                for zero in (0.0, ticks / 2.0):
                    yield self.unit(
                        f"servo ticks, {ticks} a turn", remedy,
                        np.where(turns, _TURN / ticks, 1.0), np.where(turns, zero, 0.0), True,
                    )  # fmt: skip
        width = self._upper - self._lower
        if np.isfinite(width).all():
            for low, high in ((-100.0, 100.0), (0.0, 100.0), (-1.0, 1.0)):
                factor = width / (high - low)
                above = f"(value + {-low:g})" if low else "value"
                remedy = f"an angle is lower + {above}/{high - low:g} (upper - lower)"
                yield self.unit(
                    f"parts of the joints' ranges, {low:g} to {high:g}",
                    f"{remedy}, by the limits that it was calibrated with", factor,
                    low - self._lower / factor,
                )  # fmt: skip

    def geared(self) -> Iterator[PositionUnit]:
        """Yield motor angles: by the ratios that velocities show, or by one that weight does."""
        slopes, turns = self._slopes, self.turns
        if (slopes > 0.0).all() and not self._same_unit:
            geared = np.abs(slopes - 1.0) >= _SAME_SPEED
            ratios = ", ".join(
                f"{ratio:.3g} at {name}" if not geared.all() else f"{ratio:.3g}"
                for name, ratio, other in zip(self._names, 1.0 / slopes, geared, strict=True)
                if other
            )
            yield self.unit(
                f"motor angles, through gears of {ratios}", "divide them by these",
                np.where(geared, slopes, 1.0),
            )  # fmt: skip
        if not self._weighs:
            return
        for joint in np.flatnonzero(turns):  # the motor's angle at one joint
            alone = np.arange(len(turns)) == joint
            yield from self._shown_by_weight(
                alone, f"motor angles at {self._names[joint]}, through a gear of about {{:.3g}}",
                "divide them by its ratio",
            )  # fmt: skip
        if np.isfinite(np.where(turns, self._reach, np.inf)).any():
            yield from self._shown_by_weight(
                turns, "motor angles, through gears of about {:.3g} on average",
                "divide each by the ratio of its gear",
            )  # fmt: skip

    def _shown_by_weight(self, of: Mask, words: str, remedy: str) -> Iterator[PositionUnit]:
        """Yield the angles of the motors of some (n,) joints, at the ratio that weight shows."""
        past = np.maximum(-self._low, self._high) / self._reach
        if (past[~of] > 1.0).any():
            return
        ratios = max(float(np.max(past[of])), 1.1) * _GEARS
        tried = [self.judged(self.unit("", "", np.where(of, 1.0 / ratio, 1.0))) for ratio in ratios]
        best = min(tried, key=lambda each: each.misfit)
        if best.misfit < _LEFT:
            ratio = 1.0 / best.factor[of].max()
            yield replace(best, words=words.format(ratio), remedy=remedy, fitted=True)

    @property
    def _reach(self) -> Array:
        """(n,) farthest positions from zero, up to the error of a zero; ``inf``: no limits."""
        return np.asarray(np.maximum(np.maximum(-self._lower, self._upper), 0.0) + _PAST)

    def fitting(self, units: Iterable[PositionUnit]) -> list[PositionUnit]:
        """Return the units that fit limits, velocities and weight, the best one of each name."""
        within = [unit for unit in units if self._within(unit)]
        if not self._same_unit and (agree := [unit for unit in within if self._agrees(unit)]):
            within = agree
        best: list[PositionUnit] = []  # of equal ones the first, which has a name
        for unit in sorted(map(self.judged, within), key=lambda unit: unit.anywhere):
            same = [each for each in best if self._same(each, unit)]
            if not same:
                best.append(unit)
            elif unit.misfit < same[0].misfit and unit.words == same[0].words:
                best[best.index(same[0])] = unit
        found = sorted(best, key=lambda unit: unit.misfit)
        if not (found and found[0].misfit < _LEFT):
            return [unit for unit in found if not unit.fitted]
        found = [unit for unit in found if unit.misfit <= _WORSE * found[0].misfit]
        named = [unit for unit in found if not unit.fitted]
        return named or found

    def _same(self, first: PositionUnit, second: PositionUnit) -> bool:
        """Whether two units differ by no more than a gear's ratio is known by weight."""
        ratio = (first.factor / second.factor)[self.turns]
        return bool((np.abs(np.log(ratio)) < _SAME).all() and first.anywhere == second.anywhere)

    def judged(self, unit: PositionUnit) -> PositionUnit:
        """Return a unit with what weight and friction leave of the efforts at its angles."""
        return replace(unit, misfit=float((self._left(unit) ** 2).sum())) if self._weighs else unit

    def _left(self, unit: PositionUnit) -> Array:
        """Return (N n,) what weight and friction leave of efforts, over the root sum of squares."""
        arm, rows, effort = self._arm, self._rows, self._recording.effort
        assert arm.inertial_parameters is not None
        assert effort is not None
        q = unit.joint(self._read[rows])
        masses = arm.inertial_parameters.ravel()
        weight = rigid_body.torque(arm, masses, q, None, None, arm.gravity)
        speeds, pairs = self._speed[rows].T, np.stack([effort[rows], weight], axis=2)
        left = [without_friction(pairs[:, k], speed) for k, speed in enumerate(speeds)]
        effort, weight = np.stack(left, axis=1).reshape(-1, 2).T
        scale = max(float(effort @ weight), 0.0) / max(float(weight @ weight), 1e-300)
        size = max(float(np.linalg.norm(effort)), 1e-300)
        return np.asarray((effort - scale * weight) / size)

    @cached_property
    def _rows(self) -> slice:
        return slice(None, None, max(1, len(self._read) // _SAMPLES))

    @cached_property
    def _weighs(self) -> bool:
        """Whether the arm's masses show their weight in the efforts of all joints."""
        arm, effort = self._arm, self._recording.effort
        return (
            effort is not None
            and arm.inertial_parameters is not None
            and arm.gravity_in_reading
            and not arm.newtons_stated  # or the masses are not believed
            and arm.direct_drive
            and self._names == arm.joint_names
            and not not_recorded(effort).any()
        )

    @cached_property
    def _speed(self) -> Array:
        """(N, n) velocity, in the positions' unit a second; zero of poses."""
        time = self._recording.time
        if time is None or len(time) < 3:
            return np.zeros_like(self._read)
        return np.asarray(np.gradient(self._read, time, axis=0))

    @cached_property
    def _slopes(self) -> Array:
        """(n,) recorded velocity over that of the positions; 0 where it is none, or not known."""
        time, velocity = self._recording.time, self._recording.velocity
        slopes = np.zeros(len(self._names))
        if time is None or velocity is None or len(time) < 3:
            return slopes
        step = max(1, round(_MOMENT / max(float(np.median(np.diff(time))), 1e-9)))
        means = 0.5 * (velocity[1:] + velocity[:-1]) * np.diff(time)[:, None]
        integral = np.vstack([np.zeros(len(slopes)), np.cumsum(means, axis=0)])
        way, expected = self._read[step:] - self._read[:-step], integral[step:] - integral[:-step]
        shared, squares = (way * expected).sum(axis=0), (way**2).sum(axis=0)
        size = np.sqrt(squares * (expected**2).sum(axis=0))
        clear = shared > _CLEAR * size
        return np.where(clear & (size > 0.0), shared / np.maximum(squares, 1e-300), slopes)

    @cached_property
    def _same_unit(self) -> bool:
        """Whether velocities are in the positions' unit, or show no other."""
        slopes = self._slopes[self._slopes > 0.0]
        return not len(slopes) or bool((np.abs(slopes - 1.0) < _SAME_SPEED).all())

    @property
    def follow_velocities(self) -> bool:
        """Whether velocities were recorded at all joints, in the positions' unit."""
        return bool((self._slopes > 0.0).all()) and self._same_unit

    def _within(self, unit: PositionUnit) -> bool:
        """Whether joints keep within their limits, up to the error of a zero."""
        past = _PAST * self._recording.scale
        lower, upper = np.maximum(self._lower, -ENDLESS), np.minimum(self._upper, ENDLESS)
        low, high = unit.joint(np.stack([self._low, self._high]))
        if unit.anywhere:
            return bool((high - low <= upper - lower + past).all())
        return bool(((low >= lower - past) & (high <= upper + past)).all())

    def _agrees(self, unit: PositionUnit) -> bool:
        """Whether velocities in rad/s agree with it."""
        known = self._slopes > 0.0
        return bool((np.abs(self._slopes / unit.factor - 1.0)[known] < _SAME_SPEED).all())
