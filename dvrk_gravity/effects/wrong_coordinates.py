"""Recordings read in wrong coordinates, with wrong signs, or with joints exchanged."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects.base.effect import Effect
from dvrk_gravity.effects.base.meaning import Estimate
from dvrk_gravity.effects.base.reading_errors import ReadingErrors
from dvrk_gravity.effects.base.sensor import SensorEffect
from dvrk_gravity.effects.time_scale import TimeScale
from dvrk_gravity.effects.torque_scale import TorqueScale
from dvrk_gravity.parameters import Parameter, Value

_DETECTED = "detected"  # from the recording, by every verb


class WrongCoordinates(SensorEffect):
    """The readings are another linear combination of the joints than they are taken for.

    Coordinates are a parameter of their own. Wrong signs are factors of -1, as of ``torque_scale``
    and ``encoder_scale``, and exchanged joints are rows, as of ``joint_coupling``.
    """

    NAME = "wrong_coordinates"
    COORDINATES = "reading.coordinates"
    REMEDY = "correct the mapping of the joints"

    @classmethod
    def schema(cls, arm: Arm) -> tuple[Parameter, ...]:
        meaning = "coordinates of recordings that do not state theirs"
        choices = (_DETECTED, "joint", "actuator")
        return (Parameter(cls.COORDINATES, _DETECTED, "", meaning, choices=choices),)

    @classmethod
    def read(cls, arm: Arm, values: Mapping[str, Value], errors: ReadingErrors) -> ReadingErrors:
        given = str(values.get(cls.COORDINATES, _DETECTED))
        return errors if given == _DETECTED else replace(errors, coordinates=given)

    @classmethod
    def written(cls, arm: Arm, errors: ReadingErrors) -> dict[str, Value]:
        return {cls.COORDINATES: errors.coordinates} if errors.coordinates else {}

    @classmethod
    def invalidates_commands(cls, arm: Arm, errors: ReadingErrors) -> bool:
        """Joint coordinates are those that a node expects."""
        return errors.coordinates == "actuator"


@dataclass(frozen=True, eq=False)
class Reading:
    """Another way to read a recording.

    Attributes:
        words: What it assumes.
        joints: Indices of the joints concerned; empty if all are.
        motion: (n, n) read position, velocity and acceleration -> the true ones.
        effort: (n, n) read effort -> the true one.
        coordinates: That a recording must be said to be in, to be read so; ``""`` if that is not
            enough.
        sign: Whose sign is wrong, where nothing else is.
        clock: Recorded over true time; ``None``: the times are right.
        scale: Read over true effort; ``None``: it is right.
    """

    words: str
    joints: tuple[int, ...]
    motion: Array
    effort: Array
    coordinates: str = ""
    sign: str = ""
    clock: Estimate | None = None
    scale: Estimate | None = None

    @property
    def effect(self) -> type[Effect]:
        """The effect that it assumes."""
        if self.scale is not None:
            return TorqueScale
        return WrongCoordinates if self.clock is None else TimeScale

    @property
    def factor(self) -> Estimate | None:
        """Reading over true value, if only a factor is wrong."""
        return self.clock or self.scale

    @property
    def density(self) -> Array:
        """(n,) log-density of a sample of the efforts, of the true less of the read ones.

        Errors of efforts that are read as a tenth are a tenth, and no better for it.
        """
        scaled = np.isin(np.arange(len(self.effort)), self.joints) | (not self.joints)
        return np.where(scaled, 0.0 if self.scale is None else np.log(self.scale.value), 0.0)

    @property
    def rate(self) -> float:
        """True over recorded velocity, if only the clock is wrong."""
        return 1.0 if self.clock is None else self.clock.value

    @property
    def errors(self) -> ReadingErrors | None:
        """The errors that it corrects; ``None`` where a recording itself states them."""
        right = ReadingErrors.none(len(self.effort))
        if self.coordinates:
            stated = self.coordinates == "joint"  # joint coordinates are what is assumed
            return None if stated else replace(right, coordinates=self.coordinates)
        position, effort = (np.asarray(np.linalg.inv(m)) for m in (self.motion, self.effort))
        return replace(right, position=position, effort=effort, clock=self.rate)

    @property
    def moves(self) -> bool:
        """Whether it is another reading of the motion, too, and not of the efforts alone."""
        return self.clock is not None or not np.array_equal(self.motion, np.eye(len(self.motion)))

    @property
    def remedy(self) -> str:
        """What to do about it."""
        if self.coordinates:
            return f"pass --coordinates {self.coordinates}"
        if self.sign:
            return f"correct the sign of {self.sign}, where it is read or recorded"
        if self.scale is not None and not self.joints:
            return "check the unit and the scale of all efforts"
        return self.effect.REMEDY


def readings(arm: Arm, moves: NDArray[np.bool_]) -> Iterator[Reading]:
    """Yield every other way to read all joints of an arm: coordinates, signs, order."""
    eye = np.eye(arm.n)
    forth, back = arm.actuator_to_joint, arm.joint_to_actuator
    if np.any(forth != eye):
        words = "these are {} coordinates, read as {} coordinates"
        yield Reading(words.format("actuator", "joint"), (), forth, back.T, "actuator")
        yield Reading(words.format("joint", "actuator"), (), back, forth.T, "joint")
    if len(eye) > 1:
        all_of = "the efforts of all joints"
        yield Reading(f"{all_of} have the wrong sign", (), eye, -eye, sign=all_of)
    for joint in np.flatnonzero(moves).tolist():
        flip = np.diag(np.where(np.arange(len(eye)) == joint, -1.0, 1.0))
        yield from _sign_readings(arm.joint_names[joint], joint, flip, flip)
        # Of a motor that shares joints with others, or whose joint others move, it is another one.
        motion, effort = forth @ flip @ back, back.T @ flip @ forth.T
        if np.allclose(motion, flip) and np.allclose(effort, flip):
            continue
        yield from _sign_readings(f"{arm.joint_names[joint]}'s motor", joint, motion, effort)
    for first in range(len(eye)):
        for second in range(first + 1, len(eye)):
            order = np.arange(len(eye))
            order[[first, second]] = (second, first)
            exchange, pair = eye[order], (first, second)
            names = " and ".join(arm.joint_names[joint] for joint in pair)
            yield Reading(f"{names} are exchanged", pair, exchange, exchange)
            yield Reading(f"the efforts of {names} are exchanged", pair, eye, exchange)
            yield Reading(f"the positions of {names} are exchanged", pair, exchange, eye)


def _sign_readings(name: str, joint: int, motion: Array, effort: Array) -> Iterator[Reading]:
    """Yield the readings of a joint or motor by whose signs its motion and effort are turned."""
    eye, at = np.eye(len(motion)), (joint,)
    force, place = f"the effort of {name}", f"the position of {name}"
    moves = f"{place}, and of its velocity"
    words = f"all signs of {name} are reversed"
    yield Reading(words, at, motion, effort, sign=f"{moves} and effort")
    yield Reading(f"{force} has the wrong sign", at, eye, effort, sign=force)
    yield Reading(f"{place} has the wrong sign", at, motion, eye, sign=moves)
